# SPDX-License-Identifier: Apache-2.0
"""Find names and docstrings that do not say by themselves what they are about.

    python scripts/plain_english.py [PATH ...]

Each finding is printed with its file and line. ``test/test_english.py`` holds the number of findings in
each room; it only falls.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ('stickslip_logs', 'stickslip_monitor', 'stickslip_lab')
# Folders beside the packages, whose names are read as well.
BESIDE = ('benchmarks', 'fuzz', 'scripts', 'test')

# Words that begin a clause, which is no sentence: "What came of it."
CLAUSE_WORDS = re.compile('by|for|from|how|if|in|of|that|what|when|where|which|who|whose|why|with')
# Words that begin a noun phrase, which fits a value and not a function: "The rows of a table."
NOUN_WORDS = re.compile('a|all|an|any|each|every|its?|no|one|other|so|some|such|the|these|this|those')
# Names that do not say of what.
VAGUE_NAMES = re.compile(
    'able|asked|both|each|few|found|heard|here|kept|known|least|like|most|odd|others?|own|said|some|there|told|what'
)
# A private name of one word.
ONE_WORD = re.compile('_[^_]+')

Function = ast.FunctionDef | ast.AsyncFunctionDef


class FindingKind(str, Enum):
    """Kinds of finding."""

    CLAUSE = 'the summary is a clause'
    NOUN = 'the summary of a function is a noun'
    VAGUE = 'a name does not say of what'
    ONE_WORD = 'a private function is one word: verb and object'


class Finding(NamedTuple):
    """A name or docstring to rewrite."""

    line: int
    kind: FindingKind
    name: str


def _is_property(node: Function) -> bool:
    decorators = ' '.join(ast.unparse(decorator) for decorator in node.decorator_list)
    return 'property' in decorators or 'setter' in decorators


def _check_summary(node: Function | ast.ClassDef) -> Iterator[Finding]:
    words = (ast.get_docstring(node) or '').split(maxsplit=1)
    if not words:
        return
    first = words[0].strip('`:.,').lower()
    is_value = isinstance(node, ast.ClassDef) or _is_property(node)
    if CLAUSE_WORDS.fullmatch(first) or (first == 'whether' and not is_value):
        yield Finding(node.lineno, FindingKind.CLAUSE, node.name)
    elif NOUN_WORDS.fullmatch(first) and not is_value:
        yield Finding(node.lineno, FindingKind.NOUN, node.name)


def find_in_source(source: str) -> Iterator[Finding]:
    """Yield the findings of a module's source text.

    Raises:
        SyntaxError: The text is not Python.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.arg) and VAGUE_NAMES.fullmatch(node.arg):
            yield Finding(node.lineno, FindingKind.VAGUE, node.arg)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and VAGUE_NAMES.fullmatch(node.id):
            yield Finding(node.lineno, FindingKind.VAGUE, node.id)
        if isinstance(node, Function | ast.ClassDef):
            yield from _check_summary(node)
        if isinstance(node, Function) and not _is_property(node) and ONE_WORD.fullmatch(node.name):
            yield Finding(node.lineno, FindingKind.ONE_WORD, node.name)


def find_in(path: Path) -> list[tuple[Path, Finding]]:
    """Return the findings in a file, or in all Python files below a folder, in order of files and lines."""
    files = [path] if path.is_file() else sorted(path.rglob('*.py'))
    sources = [file for file in files if 'node_modules' not in file.parts]
    return [
        (file, finding) for file in sources for finding in sorted(find_in_source(file.read_text('utf-8')))
    ]


def count_by_room() -> Counter[str]:
    """Return the number of findings by room; files beside the rooms of a folder count under its name."""
    counts = Counter[str]()
    for folder in (*PACKAGES, *BESIDE):
        for path, _ in find_in(ROOT / folder):
            inside = path.relative_to(ROOT).parts
            counts['/'.join(inside[:2]) if len(inside) > 2 else inside[0]] += 1
    return counts


def main(arguments: list[str]) -> int:
    """Print the findings of files and folders; return 1 if there are any."""
    findings = [row for name in arguments or (*PACKAGES, *BESIDE) for row in find_in(Path(name))]
    for path, (line, kind, name) in findings:
        print(f'{path}:{line}: {kind.value}: {name}')
    return bool(findings)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
