# SPDX-License-Identifier: Apache-2.0
"""Builds and checks the configuration of links: which bus brings and takes what.

The section ``/stickslip_links`` of the parameter file says it; see docs/ship.md.
"""

from __future__ import annotations

import ipaddress
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import SplitResult, urlsplit

from stickslip_monitor.errors import ConfigurationError, did_you_mean
from stickslip_monitor.monitor.parameter_file import LINKS
from stickslip_monitor.monitor.parameters import (
    BearingConfig,
    InputConfig,
    MonitorConfig,
    build_section,
    declared_parameters,
    parameter,
)
from stickslip_monitor.monitor.sample_types import Input
from stickslip_monitor.monitor.value_check import REQUIRED, require_rule

SIGNALK, NMEA = 'signalk', 'nmea'
UNITS = {Input.SPEED: 'Hz', Input.LOAD: 'N', Input.WATER_TEMPERATURE: 'K'}
"""Of the inputs, as Signal K has them."""
BUS_INPUTS = tuple(place.name.lower() for place in UNITS)
"""The names of the inputs that a bus may bring."""
_PATH = re.compile(r'[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)+')
_PORTS = {'udp': 'udp://127.0.0.1:10110', 'tcp': 'tcp://127.0.0.1:10110', 'serial': 'serial:///'}
_NOTHING_SENT = 'false without signalk.prefix: nothing is sent that somebody could act on'
_SHAFT = 'S for a shaft or E for an engine'
BAUD_RATES = (4800, 9600, 19200, 38400, 57600, 115200)
"""Rates of a serial line [baud]."""
UNHEARD = 5.0
"""Silence of an input, an echo or a peer that was called, after which it is reported [s]."""


@dataclass(frozen=True, slots=True)
class SignalKLink:
    """Use of a Signal K server."""

    url: str = parameter('', 'Address of the server, http:// or https://.')
    token_file: str = parameter('', 'File with its token.')
    ca_file: str = parameter('', 'Certificate of its CA; the CAs of the system without one.')
    prefix: str = parameter('', 'Path under which values and alarms are sent.')
    accept_actions: bool = parameter(False, 'Carry out acknowledgements and silencing from there.')


def _period_parameter(default: float, text: str) -> Any:
    """Return the field of a parameter that is a time [s], of 1 to 600, between two sendings."""
    return parameter(default, text, 's', within=(1.0, 600.0))


@dataclass(frozen=True, slots=True)
class NmeaLink:
    """Use of NMEA 0183."""

    listen: str = parameter('', 'Where sentences come from: udp://, tcp:// or serial://.')
    alerts: str = parameter('', 'Where alert sentences go.')
    talker: str = parameter('II', 'Our talker identifier.')
    manufacturer: str = parameter('', 'Our manufacturer code.')
    first_alert: int = parameter(10001, 'Identifier of our first alert.', within=(1, 999994))
    list_period: float = _period_parameter(30.0, 'Time between two lists of alerts.')
    heartbeat: float = _period_parameter(60.0, 'Time between two heartbeats.')
    accept_actions: bool = parameter(False, 'Carry out acknowledgements and silencing by ACN.')


LINK_PARAMETERS = declared_parameters(SignalKLink, 'signalk.') + declared_parameters(NmeaLink, 'nmea.')
"""The parameters of the buses."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BusInput:
    """One number on a bus that is an input of a bearing."""

    bearing: str
    place: Input
    timeout: float = 5.0  # how long a value of the input counts [s]
    hold: float = 0.0  # how long it stands where its source sends changes only [s]
    bus: str = parameter(REQUIRED, 'The bus.', choices=(SIGNALK, NMEA), name='from')
    path: str = parameter('', 'Signal K: the path.')
    source: str = parameter('', 'Signal K: the only `$source` to use.')
    sentence: str = parameter('', 'NMEA: RPM for the speed, XDR for the load.')
    talker: str = parameter('', 'NMEA: the only talker to use.')
    kind: str = parameter('', 'NMEA: S shaft or E engine of RPM; type of transducer of XDR.')
    number: int = parameter(1, 'NMEA: number of the shaft or engine of RPM.', within=(0, math.inf))
    name: str = parameter('', 'NMEA: name of the transducer of XDR.')

    @property
    def only(self) -> str:
        """The only source to use; empty to stay with the first that sends."""
        return self.source if self.bus == SIGNALK else self.talker

    @property
    def label(self) -> str:
        """Path, or sentence and transducer or shaft, for a person."""
        if self.bus == SIGNALK:
            return f'Signal K {self.path}'
        return f'NMEA {self.sentence} {self.name or f"{self.kind} {self.number}"}'

    @property
    def max_silence(self) -> float:
        """Time without a value from which the input is reported as silent [s]."""
        return max(UNHEARD, self.hold)


INPUT_PARAMETERS = declared_parameters(BusInput)
"""The parameters of one input of a bearing, under ``<bearing>.speed`` and ``<bearing>.load``."""


@dataclass(frozen=True, slots=True)
class LinksConfig:
    """The buses that are used, and the inputs that come from them."""

    signalk: SignalKLink | None
    nmea: NmeaLink | None
    inputs: tuple[BusInput, ...]

    def of(self, bus: str) -> list[BusInput]:
        """Return the inputs that come from a bus."""
        return [item for item in self.inputs if item.bus == bus]

    @property
    def labels(self) -> dict[tuple[str, Input], str]:
        """Origin of each input, for a person."""
        return {(item.bearing, item.place): item.label for item in self.inputs}


def is_loopback(host: str | None) -> bool:
    """Return whether a host is this machine, as far as its name shows; false for ``None``."""
    try:
        return host == 'localhost' or ipaddress.ip_address(host or '').is_loopback
    except ValueError:
        return False


def build_links(values: Mapping[str, Any], config: MonitorConfig) -> LinksConfig:
    """Build the use of buses from flat, dotted parameters of the section.

    Args:
        values: Parameter values by full name, e.g. ``{'aft.speed.from': 'signalk'}``.
        config: The monitor's configuration.

    Raises:
        ConfigurationError: A parameter is unknown, a value breaks its rule, or no bus is used; the text names
            parameter, value and rule.
    """
    _refuse_unknown(values, [bearing.name for bearing in config.bearings])
    settings = {p.name: p.checked(p.name, values) for p in LINK_PARAMETERS}
    inputs = tuple(
        _build_input(bearing, Input[quantity.upper()], f'{bearing.name}.{quantity}', values)
        for bearing in config.bearings
        for quantity in BUS_INPUTS
        if any(key.startswith(f'{bearing.name}.{quantity}.') for key in values)
    )
    if not (settings['signalk.url'] or settings['nmea.listen'] or settings['nmea.alerts'] or inputs):
        raise ConfigurationError(f'{LINKS} uses no bus: give signalk.url, nmea.listen or nmea.alerts')
    used = {item.bus for item in inputs}
    return LinksConfig(_build_signalk(settings, SIGNALK in used), _build_nmea(settings, NMEA in used), inputs)


def _refuse_unknown(values: Mapping[str, Any], bearings: Iterable[str]) -> None:
    """Refuse values by names that are not parameters.

    Raises:
        ConfigurationError: For the first of them; the text proposes the nearest parameter.
    """
    names = [p.name for p in LINK_PARAMETERS]
    names += [f'{b}.{q}.{p.name}' for b in bearings for q in BUS_INPUTS for p in INPUT_PARAMETERS]
    for key, value in values.items():
        if key not in names:
            hint = did_you_mean(key, names)
            raise ConfigurationError(f"{LINKS}: unknown parameter '{key}' = {value!r}{hint}")


def _split_url(name: str, value: str, example: str, schemes: Iterable[str]) -> SplitResult:
    """Split an address into its parts.

    Raises:
        ConfigurationError: It has none of the schemes, or port 0; the text names parameter and example.
    """
    try:
        url = urlsplit(value)
        fits = url.scheme in schemes and url.port != 0
    except ValueError:
        fits = False
    require_rule(fits, name, value, f'an address such as {example}')
    return url


def _build_signalk(settings: Mapping[str, Any], used: bool) -> SignalKLink | None:
    """Build the Signal K link, its address without a final slash; ``None`` without an address.

    Args:
        settings: Values by parameter, each checked by itself.
        used: Whether inputs come from it.

    Raises:
        ConfigurationError: The address is missing though inputs or a prefix need it, values do not fit
            together, or the address would show the token.
    """
    link, example = build_section(SignalKLink, 'signalk.', settings), 'http://127.0.0.1:3000'
    if not link.url:
        require_rule(not (used or link.prefix), 'signalk.url', '', 'given: Signal K is used')
        return None
    url = _split_url('signalk.url', link.url, example, ('http', 'https'))
    plain = url.hostname and url.path in ('', '/') and not (url.query or url.username)
    safe = url.scheme == 'https' or is_loopback(url.hostname) or not link.token_file
    for fits, name, rule in (
        (plain, 'url', f'an address such as {example}'),
        (safe, 'url', 'https://: a token would be sent for all to read'),
        (not link.prefix or _PATH.fullmatch(link.prefix), 'prefix', 'a Signal K path'),
        (link.prefix or not link.accept_actions, 'accept_actions', _NOTHING_SENT),
    ):
        require_rule(fits, f'signalk.{name}', settings[f'signalk.{name}'], rule)
    return replace(link, url=link.url.rstrip('/'))


def _build_nmea(settings: Mapping[str, Any], used: bool) -> NmeaLink | None:
    """Build the NMEA link; ``None`` without a port.

    Args:
        settings: Values by parameter, each checked by itself.
        used: Whether inputs come from it, which need ``nmea.listen``.

    Raises:
        ConfigurationError: A value breaks its rule.
    """
    link = build_section(NmeaLink, 'nmea.', settings)
    for fits, name, rule in (
        (link.listen or not used, 'listen', 'given: inputs come from it'),
        (re.fullmatch('[A-Z][A-Z0-9]', link.talker), 'talker', 'two upper-case letters'),
        (
            re.fullmatch('([A-Z]{3})?', link.manufacturer),
            'manufacturer',
            'three upper-case letters, or empty',
        ),
    ):
        require_rule(fits, f'nmea.{name}', settings[f'nmea.{name}'], rule)
    for name in ('nmea.listen', 'nmea.alerts'):
        if settings[name]:
            check_port(name, settings[name])
    return link if link.listen or link.alerts else None


def check_port(name: str, value: str) -> SplitResult:
    """Split the address of a port (``udp``, ``tcp`` or ``serial``) into its parts, which are checked.

    Args:
        name: Name of the parameter, for the error.
        value: The address.

    Raises:
        ConfigurationError: It is not the address of a port.
    """
    url = _split_url(name, value, ', '.join(_PORTS.values()) + 'dev/ttyUSB0?baud=4800', _PORTS)
    if url.scheme == 'serial':
        require_rule(not url.netloc and len(url.path) > 1, name, value, 'serial:///dev/ttyUSB0')
        rates = ', '.join(str(rate) for rate in BAUD_RATES)
        fits = url.query in ('', *(f'baud={rate}' for rate in BAUD_RATES))
        require_rule(fits, name, value, f'serial:///dev/ttyUSB0?baud=RATE with one of {rates}')
    else:
        whole = url.hostname and url.port and url.path in ('', '/')
        require_rule(whole, name, value, f'written {_PORTS[url.scheme]}, with host and port')
    return url


def _build_input(bearing: BearingConfig, place: Input, name: str, values: Mapping[str, Any]) -> BusInput:
    """Build one input of a bearing from the values under its name.

    Args:
        bearing: The bearing, whose time-out and hold apply.
        place: The input.
        name: Its full name, e.g. ``aft.speed``.
        values: Parameter values of all inputs by full name.

    Raises:
        ConfigurationError: A value breaks its rule, or the bearing has no such input to feed.
    """
    settings = {p.name: p.checked(f'{name}.{p.name}', values) for p in INPUT_PARAMETERS}
    load = place is Input.LOAD
    assumed = load and bearing.load.is_assumed
    require_rule(not assumed, name, settings['from'], 'left out, as the load is a constant')
    source = bearing.inputs.get(place.name.lower())
    if source is None:
        raise ConfigurationError(
            f"parameter '{name}.topic' is missing: {LINKS} brings a {place.name.lower()}"
        )
    times = {'timeout': source.stands_ns * 1e-9, 'hold': source.hold_ns * 1e-9}
    item = build_section(BusInput, '', settings, bearing=bearing.name, place=place, **times)
    if item.bus == SIGNALK:
        _check_unit(source, name, UNITS[place], 'Signal K')
        require_rule(
            _PATH.fullmatch(settings['path']), f'{name}.path', settings['path'], 'a Signal K path, without *'
        )
        return item
    is_spoken = place is not Input.WATER_TEMPERATURE
    rule = f'{SIGNALK}: NMEA brings speed and load only'
    require_rule(is_spoken, f'{name}.from', settings['from'], rule)
    sentence, kinds, kind = ('XDR', 'N', 'N, a force') if load else ('RPM', 'SE', _SHAFT)
    for fits, key, rule in (
        (settings['sentence'] == sentence, 'sentence', sentence),
        (settings['kind'] in list(kinds), 'kind', kind),
        (settings['name'] or not load, 'name', 'given: the name of the transducer'),
    ):
        require_rule(fits, f'{name}.{key}', settings[key], rule)
    _check_unit(source, name, 'N' if load else 'rpm', sentence)
    return item


def _check_unit(source: InputConfig, name: str, unit: str, who: str) -> None:
    """Check that the monitor expects the unit of the bus: numbers are passed on as received.

    Args:
        source: The input as the monitor has it.
        name: Its full name, e.g. ``aft.speed``, for the error.
        unit: Unit on the bus.
        who: Word for the bus or sentence, for the error.

    Raises:
        ConfigurationError: It expects another one.
    """
    require_rule(source.unit == unit, f'{name}.unit', source.unit, f'{unit}, in which {who} gives it')
