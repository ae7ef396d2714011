# SPDX-License-Identifier: Apache-2.0
"""Reads a ROS 2 parameter file (``/**: ros__parameters:``) without needing ROS."""

from __future__ import annotations

import logging
import re
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

import yaml

from stickslip_logs.units import MIB
from stickslip_monitor.errors import ConfigurationError, cause
from stickslip_monitor.monitor.configuration import build_config
from stickslip_monitor.monitor.parameters import MonitorConfig
from stickslip_monitor.safe_files import path_hint, read_file

# A fleet's bearings have some hundred kilobytes [bytes].
_LARGEST = MIB
NODE_NAME = 'stickslip_monitor'
LINKS = '/stickslip_links'
"""The section of a ship's buses."""
_ROS_OWN = ('use_sim_time', 'start_type_description_service')


class _Loader(yaml.SafeLoader):
    """YAML with the numbers and switches of ROS 2, where a key given twice is an error.

    PyYAML follows YAML 1.1, in which ``1e5`` is a text and ``1:30``, ``2_000_000`` and
    ``2026-11-26`` are none; rcl asks ``strtol`` and ``strtod``.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node of the document.

        Raises:
            MarkedYAMLError: It is an alias, which ROS 2 refuses too.
        """
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(
                problem=f"alias '*{event.anchor}' must be written out: ROS 2 reads no aliases",
                problem_mark=event.start_mark,
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """Return a mapping.

        Raises:
            MarkedYAMLError: A key is given twice.
        """
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                break
            if key in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"key '{key}' is given twice", problem_mark=key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


_Loader.yaml_implicit_resolvers = {}  # not those of YAML 1.1
# The bare word N is left a text: it is a unit here, and the node reads the switch back as one.
_SWITCHES = {
    word: truth
    for truth, words in ((True, 'y true yes on'), (False, 'n false no off'))
    for name in words.split()
    for word in (name, name.capitalize(), name.upper())
    if word != 'N'
}
_REALS = (
    r'[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?\.?(?:inf|Inf|INF)'
    r'|[-+]?(?:infinity|Infinity)|\.?(?:nan|NaN|NAN)'
)
for _tag, _pattern, _starts in (
    ('bool', '|'.join(_SWITCHES), 'yYntTNfFoO'),
    ('null', '~|null|Null|NULL|', ['~', 'n', 'N', '']),
    ('int', '[-+]?(?:0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)', '-+0123456789'),
    ('float', _REALS, '-+.0123456789iInN'),
):
    _Loader.add_implicit_resolver(f'tag:yaml.org,2002:{_tag}', re.compile(f'(?:{_pattern})$'), list(_starts))
_Loader.add_constructor('tag:yaml.org,2002:bool', lambda _, node: _SWITCHES[node.value])


class _ParameterLoader(_Loader):
    """Refuses besides what a node refuses: keys without a value, and lists of several types."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """Return a mapping whose keys are texts.

        Raises:
            MarkedYAMLError: A key has no value, or is given twice.
        """
        for key_node, value_node in node.value:
            if isinstance(key_node, yaml.ScalarNode):
                key_node.tag = 'tag:yaml.org,2002:str'  # a bearing called n is no switch
                self._refuse_empty(key_node, value_node)
        return super().construct_mapping(node, deep)

    def construct_sequence(self, node: yaml.SequenceNode, deep: bool = False) -> list[Any]:
        """Return a list; whole numbers in a list of pairs become floats.

        Raises:
            MarkedYAMLError: Its items have several types.
        """
        tags = {item.tag.rsplit(':', 1)[-1] for item in node.value}
        if tags == {'seq'}:
            # A list of pairs, as no node reads it: whole numbers and others may stand side by side.
            for number in (one for pair in node.value for one in pair.value):
                if number.tag == 'tag:yaml.org,2002:int':
                    number.tag = 'tag:yaml.org,2002:float'
        if len(tags) > 1:
            mixed = ' and '.join(sorted(tags))
            remedy = ': write 0.0 in place of 0' if tags == {'int', 'float'} else ''
            raise yaml.MarkedYAMLError(
                problem=f'a list mixes {mixed}, which ROS 2 refuses{remedy}', problem_mark=node.start_mark
            )
        return super().construct_sequence(node, deep)

    @staticmethod
    def _refuse_empty(key: yaml.ScalarNode, value: yaml.Node) -> None:
        """Raise a MarkedYAMLError where a key has no value; quotation marks are one."""
        if isinstance(value, yaml.ScalarNode) and not value.value and value.style is None:
            remedy = (
                ': in braces a comma separates entries, so write a decimal point'
                if key.value.isdigit()
                else ''
            )
            raise yaml.MarkedYAMLError(
                problem=f"key '{key.value}' has no value{remedy}", problem_mark=key.start_mark
            )


def load_yaml(path: str | Path, loader: type[_Loader] = _Loader) -> object:
    """Parse one YAML file of up to a megabyte, and return its document; ``None`` for an empty one.

    ``loader`` is what reads it: by default numbers and switches of ROS 2, and no key twice.

    Raises:
        ConfigurationError: It cannot be read or is not YAML; the text names file, line and fault.
    """
    try:
        text = read_file(path, _LARGEST).decode()
        return yaml.load(text, loader)  # a SafeLoader
    except FileNotFoundError as error:
        raise ConfigurationError(f'{path}: {cause(error)}{path_hint(path)}') from error
    except OSError as error:
        raise ConfigurationError(f'{path}: {cause(error)}') from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f'{path} is not a text file: {error.reason}') from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f', line {mark.line + 1}' if mark else ''
        raise ConfigurationError(f'{path}{line}: {error.problem}') from error
    except yaml.YAMLError as error:
        raise ConfigurationError(f'{path} is not YAML: {" ".join(str(error).split())}') from error
    except (ValueError, AttributeError, LookupError, TypeError, OverflowError) as error:
        raise ConfigurationError(f'{path} holds a value that cannot be read: {error}') from error
    except RecursionError as error:
        raise ConfigurationError(f'{path} is nested too deeply') from error


def load_parameters(path: str | Path, node: str | None = None) -> dict[str, Any]:
    """Return the parameters that a file gives a node, by their dotted names, in the file's order.

    Without the node's full name it is the only one that the file names. Parameters that are null, or that
    every ROS 2 node has, are left out.

    Raises:
        ConfigurationError: The file cannot be read, has no parameters for the node, or is for several nodes;
            the text names it.
    """
    return _node_parameters(path, load_yaml(path, _ParameterLoader), node)


def _node_parameters(path: str | Path, document: object, node: str | None) -> dict[str, Any]:
    """Return what :func:`load_parameters` does, of a document that was read already.

    Raises:
        ConfigurationError: There are none, one is given twice, or the file is for several nodes.
    """
    if not isinstance(document, Mapping):
        raise ConfigurationError(
            f"{path} must be a ROS 2 parameter file: '/**:' with 'ros__parameters:' inside"
        )
    sections = list(_iterate_sections(path, '', document))
    name = _choose_node(path, _candidate_sections(sections), node)
    merged: dict[str, Any] = {}
    for section, content in sections:
        if _is_for_node(section, name):
            merged.update(_flatten_content(path, content))
    if not merged:
        names = ', '.join(str(section) for section in document)
        raise ConfigurationError(
            f"{path} has no parameters for '{node or NODE_NAME}': its sections are {names}; use '/**'"
        )
    # 'ros2 param dump' writes what is not set as null.
    return {key: value for key, value in merged.items() if value is not None and not is_ros_parameter(key)}


def _iterate_sections(
    path: str | Path, space: str, content: Mapping[Any, Any]
) -> Iterator[tuple[str, Mapping[Any, Any]]]:
    """Yield the full name of each section, which may be a pattern, with its parameters, nested or not.

    Of what has no ``ros__parameters`` the sections inside are taken; what is not a mapping is skipped.
    ``path`` is for the error; ``space`` is the name that these sections are nested in, '' at the top.

    Raises:
        ConfigurationError: ``ros__parameters`` of a section is not a mapping, or a section for our node, or
            for any, has none.
    """
    for key, inside in content.items():
        name = f'{space}/{str(key).strip("/")}'
        held: Mapping[Any, Any] = inside if isinstance(inside, Mapping) else {}
        parameters = held.get('ros__parameters')
        if isinstance(parameters, Mapping):
            yield name, parameters
        elif 'ros__parameters' in held or name.rsplit('/', 1)[-1] in (NODE_NAME, '*', '**'):
            raise ConfigurationError(f"{path}: section '{key}' must hold 'ros__parameters:'")
        else:
            yield from _iterate_sections(path, name, held)


def _candidate_sections(sections: Sequence[tuple[str, Mapping[Any, Any]]]) -> Iterator[str]:
    """Yield names of sections that may be for our node, in order; patterns only if they name a bearing."""
    listed = [content['bearings'] for _, content in sections if 'bearings' in content]
    words = {'bearings', *(str(name) for names in listed if isinstance(names, list) for name in names)}
    for section, content in sections:
        if '*' not in section or words & {str(key).partition('.')[0] for key in content}:
            yield section


def _choose_node(path: str | Path, sections: Iterable[str], node: str | None) -> str:
    """Return the full name of the node to read for; '' where no section names a namespace.

    Args:
        path: The file, for the message.
        sections: Names of its sections.
        node: The node asked for: it is returned with one leading slash, and need not be in the file; ``None``
            for the one that the sections name.

    Raises:
        ConfigurationError: Sections name several nodes, and ``node`` does not choose.
    """
    if node is not None:
        return f'/{node.strip("/")}'
    named = list(dict.fromkeys(name for name in map(_node_named_by, sections) if name))
    if len(named) > 1:
        raise ConfigurationError(f'{path} is for several nodes: choose one of {", ".join(named)} by --node')
    # Where no namespace stands, all sections are for the node, whatever its own.
    return named[0] if named else ''


def _node_named_by(section: str) -> str:
    """Return the full name of the monitor that a section is for: '/port/stickslip_monitor' for '/port/**'.

    '' where the section begins with a wildcard, so that it names no namespace, or is for other nodes.
    """
    steps = section.strip('/').split('/')
    named = list(takewhile(lambda step: '*' not in step, steps))
    name = '/'.join(['', *(step for step in named if step != NODE_NAME), NODE_NAME])
    return name if named and _is_for_node(section, name) else ''


def _is_for_node(pattern: str, name: str) -> bool:
    """Return whether a section of a file is for a node, by the wildcards of rcl (``*`` one step, ``**`` any).

    Args:
        pattern: Name of the section.
        name: Full name of the node; '' for the monitor in whatever namespace, by the last step alone.
    """
    if not name:
        return pattern.rsplit('/', 1)[-1] in (NODE_NAME, '*', '**')
    parts = {'**': '(/[^/]+)*', '*': '/[^/]+'}
    steps = pattern.strip('/').split('/')
    return bool(re.fullmatch(''.join(parts.get(s, '/' + re.escape(s)) for s in steps), name))


def load_config(path: str | Path, node: str | None = None, *, is_live: bool = False) -> MonitorConfig:
    """Read and validate a parameter file, and return its configuration.

    A parameter without effect and a calibration that cannot be used are logged as warnings. Paths of
    calibrations are relative to the file. An input with neither topic nor column gets the column of the
    ship's buses, if the file has one, and any input the sender that is chosen there.

    Args:
        path: The file.
        node: Full name of the node whose parameters are read, where the file has several; else ``None``.
        is_live: Whether a ship is to be monitored now, see :func:`.configuration.build_config`.

    Raises:
        ConfigurationError: The file cannot be read or breaks a rule; the text names the file.

    Examples:
        >>> load_config('launch_configs/reference_bearing.yaml').bearings[0].name
        'aft_stern'
    """
    document = load_yaml(path, _ParameterLoader)
    parameters = _node_parameters(path, document, node)
    for name, value in parameters.items():
        if name.endswith('.calibration') and isinstance(value, str) and value:
            parameters[name] = str(Path(path).parent / value)
    for name, (column, sender) in _columns_of_buses(path, document).items():
        if not {f'{name}.topic', f'{name}.column'} & parameters.keys():
            parameters[f'{name}.column'] = column
        if sender:
            parameters.setdefault(f'{name}.sender', sender)
    try:
        config = build_config(parameters, is_live=is_live)
    except ConfigurationError as error:
        raise ConfigurationError(f'{path}: {error}') from error
    for note in (*config.notes, *config.faults):
        logging.getLogger(NODE_NAME).warning('%s: %s', path, note)
    return config


def _columns_of_buses(path: str | Path, document: object) -> dict[str, tuple[str, str]]:
    """Return column and sender of each input, as ``aft.speed``, in a log of a ship's buses.

    It is empty where the file has no section of buses, or one that gives a parameter twice. A column is the
    path of Signal K, the name of the transducer, or ``RPM S 1`` with kind and number of the shaft; the sender
    the only source or talker to use, '' for the first.
    """
    try:
        links = _read_links(path, document)
    except ConfigurationError:
        return {}
    columns = {}
    for name in [key.removesuffix('.from') for key in links if key.endswith('.from')]:
        kind, number = links.get(f'{name}.kind', ''), links.get(f'{name}.number', 1)
        given = links.get(f'{name}.path') or links.get(f'{name}.name')
        sender = links.get(f'{name}.source') or links.get(f'{name}.talker')
        columns[name] = str(given or f'RPM {kind} {number}'), str(sender or '')
    return columns


def load_links(path: str | Path) -> dict[str, Any]:
    """Return the parameters of a ship's buses in a parameter file, by dotted names; ``None`` for null.

    Raises:
        ConfigurationError: The file cannot be read, has no such section, or gives a parameter twice.
    """
    return _read_links(path, load_yaml(path, _ParameterLoader))


def _read_links(path: str | Path, document: object) -> dict[str, Any]:
    """Return the parameters of the section :data:`LINKS` by dotted names; ``None`` for null.

    Raises:
        ConfigurationError: There is no such section, or one is given twice; the text names ``path``.
    """
    content = document.get(LINKS) if isinstance(document, Mapping) else None
    parameters = content.get('ros__parameters') if isinstance(content, Mapping) else None
    if not isinstance(parameters, Mapping):
        raise ConfigurationError(f"{path} has no section '{LINKS}:' with 'ros__parameters:'")
    return _flatten_content(path, parameters)


def is_ros_parameter(name: str) -> bool:
    """Return whether a parameter is one that every ROS 2 node has, as ``use_sim_time``."""
    return name in _ROS_OWN or name.startswith('qos_overrides.')


def _flatten_content(path: str | Path, content: Mapping[Any, Any]) -> dict[str, Any]:
    """Return nested parameters by their dotted names.

    Raises:
        ConfigurationError: One is given twice; the text names ``path``.
    """
    values: dict[str, Any] = {}
    for name, value in _iterate_flat('', content):
        if name in values:
            raise ConfigurationError(f"{path}: '{name}' is given twice, with dots and in a section: keep one")
        values[name] = value
    return values


def _iterate_flat(prefix: str, content: Mapping[Any, Any]) -> Iterator[tuple[str, Any]]:
    """Yield dotted name and value of nested parameters, each name directly after a prefix."""
    for key, value in content.items():
        name = f'{prefix}{key}'
        if isinstance(value, Mapping):
            yield from _iterate_flat(f'{name}.', value)
        else:
            yield name, value
