def page(r):
    return ''
