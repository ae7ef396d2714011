# SPDX-License-Identifier: Apache-2.0
"""The section ``/stickslip_links`` of the parameter file: which bus brings and takes what."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import SplitResult, urlsplit

from stickslip_monitor.errors import ConfigurationError, did_you_mean
from stickslip_monitor.links.nmea import NmeaInput
from stickslip_monitor.links.signalk import SignalKInput
from stickslip_monitor.monitor.config import BearingConfig, MonitorConfig
from stickslip_monitor.monitor.parameter import REQUIRED, Parameter, filled, parameter, rows
from stickslip_monitor.monitor.signals import QUANTITIES, Input
from stickslip_monitor.physics.oscillator import SPEED_UNITS

SECTION = '/stickslip_links'
SIGNALK, NMEA = 'signalk', 'nmea'
_PATH = re.compile(r'[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)+')
_PORTS = {'udp': 'udp://127.0.0.1:10110', 'tcp': 'tcp://127.0.0.1:10110', 'serial': 'serial:///'}
BAUD_RATES = (4800, 9600, 19200, 38400, 57600, 115200)


@dataclass(frozen=True, slots=True)
class SignalKLink:
    """How a Signal K server is used."""

    url: str = parameter('', 'Address of the Signal K server, http:// or https://.')
    token_file: str = parameter('', 'File with the token for that server.')
    ca_file: str = parameter('', "Certificate of whoever signed the server's.")
    prefix: str = parameter('', 'Path under which values and alarms are sent; empty for none.')
    accept_actions: bool = parameter(False, 'Whether people may act at the Signal K server.')


def _period(default: float, text: str) -> Any:
    return parameter(default, text, 's', minimum=1.0, maximum=600.0)


@dataclass(frozen=True, slots=True)
class NmeaLink:
    """How NMEA 0183 is used."""

    listen: str = parameter('', 'Where sentences come from: udp://, tcp:// or serial://.')
    alerts: str = parameter('', 'Where alert sentences go; empty for nowhere.')
    talker: str = parameter('II', 'Talker identifier of our sentences.')
    manufacturer: str = parameter('', 'Manufacturer code of our alerts; empty for none.')
    first_alert: int = parameter(
        10001, 'Identifier of our first alert; the six others follow.', minimum=1, maximum=999994
    )
    list_period: float = _period(30.0, 'Time between two lists of alerts.')
    heartbeat: float = _period(60.0, 'Time between two heartbeats.')
    accept_actions: bool = parameter(False, 'Whether people may act by ACN sentences.')


LINK_PARAMETERS = rows(SignalKLink, 'signalk.') + rows(NmeaLink, 'nmea.')
"""The parameters of the buses."""
INPUT_PARAMETERS = (
    Parameter('from', 'str', REQUIRED, 'The bus.', choices=(SIGNALK, NMEA)),
    Parameter('path', 'str', '', 'Signal K: the path.'),
    Parameter('source', 'str', '', 'Signal K: the only `$source` to use; empty for any one.'),
    Parameter('sentence', 'str', '', 'NMEA: RPM for the speed, XDR for the load.'),
    Parameter('talker', 'str', '', 'NMEA: the only talker to use; empty to stay with the first that sends.'),
    Parameter('kind', 'str', '', 'NMEA: S shaft or E engine of RPM; type of transducer of XDR.'),
    Parameter('number', 'int', 1, 'NMEA: number of the shaft or engine of RPM.', minimum=0),
    Parameter('name', 'str', '', 'NMEA: name of the transducer of XDR.'),
)
"""The parameters of one input of a bearing, under ``<bearing>.speed`` and ``<bearing>.load``."""


@dataclass(frozen=True, slots=True)
class LinksConfig:
    """The buses that are used, and the inputs that come from them."""

    signalk: SignalKLink | None
    nmea: NmeaLink | None
    signalk_inputs: tuple[SignalKInput, ...]
    nmea_inputs: tuple[NmeaInput, ...]

    @property
    def labels(self) -> dict[tuple[str, Input], str]:
        """Of each input where it comes from, for a person."""
        return {(i.bearing, i.place): i.label for i in self.signalk_inputs + self.nmea_inputs}


def is_loopback(host: str | None) -> bool:
    """Whether a host is this machine, as far as its name shows."""
    try:
        return host == 'localhost' or ipaddress.ip_address(host or '').is_loopback
    except ValueError:
        return False


def build_links(values: Mapping[str, Any], config: MonitorConfig) -> LinksConfig:
    """Validate flat, dotted parameters of the section.

    Args:
        values: Parameter values by full name, e.g. ``{'aft.speed.from': 'signalk'}``.
        config: The monitor's configuration.

    Raises:
        ConfigurationError: A value breaks its rule; the text names parameter, value and rule.
    """
    _refuse_unknown(values, [bearing.name for bearing in config.bearings])
    own = {p.name: p.checked(p.name, values) for p in LINK_PARAMETERS}
    inputs = [
        _input(bearing, Input[quantity.upper()], f'{bearing.name}.{quantity}', values)
        for bearing in config.bearings
        for quantity in QUANTITIES
        if any(key.startswith(f'{bearing.name}.{quantity}.') for key in values)
    ]
    if not (own['signalk.url'] or own['nmea.listen'] or own['nmea.alerts'] or inputs):
        raise ConfigurationError(f'{SECTION} uses no bus: give signalk.url, nmea.listen or nmea.alerts')
    signalk = tuple(item for item in inputs if isinstance(item, SignalKInput))
    nmea = tuple(item for item in inputs if isinstance(item, NmeaInput))
    return LinksConfig(_signalk(own, bool(signalk)), _nmea(own, bool(nmea)), signalk, nmea)


def _refuse_unknown(values: Mapping[str, Any], bearings: Iterable[str]) -> None:
    known = [p.name for p in LINK_PARAMETERS]
    known += [f'{b}.{q}.{p.name}' for b in bearings for q in QUANTITIES for p in INPUT_PARAMETERS]
    for key, value in values.items():
        if key not in known:
            hint = did_you_mean(key, known)
            raise ConfigurationError(f"{SECTION}: unknown parameter '{key}' = {value!r}{hint}")


def _require(fits: object, name: str, value: object, rule: str) -> None:
    if not fits:
        raise ConfigurationError(f'{SECTION}: {name} = {value!r} must be {rule}')


def _split(name: str, value: str, example: str, schemes: Iterable[str]) -> SplitResult:
    rule = f'an address such as {example}'
    try:
        url = urlsplit(value)
        fits = url.scheme in schemes and url.port != 0
    except ValueError:
        fits = False
    _require(fits, name, value, rule)
    return url


def _signalk(own: Mapping[str, Any], used: bool) -> SignalKLink | None:
    value, prefix = own['signalk.url'], own['signalk.prefix']
    if not value:
        _require(not (used or prefix), 'signalk.url', value, 'given: Signal K is used')
        return None
    url = _split('signalk.url', value, 'http://127.0.0.1:3000', ('http', 'https'))
    plain = url.hostname and url.path in ('', '/') and not (url.query or url.username)
    _require(plain, 'signalk.url', value, 'an address such as http://127.0.0.1:3000')
    safe = url.scheme == 'https' or is_loopback(url.hostname) or not own['signalk.token_file']
    _require(safe, 'signalk.url', value, 'https://: a token would be sent for all to read')
    _require(not prefix or _PATH.fullmatch(prefix), 'signalk.prefix', prefix, 'a Signal K path')
    actions = own['signalk.accept_actions']
    rule = 'false without signalk.prefix: nothing is sent that somebody could act on'
    _require(prefix or not actions, 'signalk.accept_actions', actions, rule)
    return replace(filled(SignalKLink, 'signalk.', own), url=value.rstrip('/'))


def _nmea(own: Mapping[str, Any], used: bool) -> NmeaLink | None:
    listen, alerts = own['nmea.listen'], own['nmea.alerts']
    _require(listen or not used, 'nmea.listen', listen, 'given: inputs come from it')
    for name in ('nmea.listen', 'nmea.alerts'):
        if own[name]:
            check_port(name, own[name])
    for name, pattern, rule in (
        ('nmea.talker', '[A-Z][A-Z0-9]', 'two upper-case letters'),
        ('nmea.manufacturer', '([A-Z]{3})?', 'three upper-case letters, or empty'),
    ):
        _require(re.fullmatch(pattern, own[name]), name, own[name], rule)
    return filled(NmeaLink, 'nmea.', own) if listen or alerts else None


def check_port(name: str, value: str) -> SplitResult:
    """The parts of the address of a port.

    Raises:
        ConfigurationError: It is none.
    """
    url = _split(name, value, ', '.join(_PORTS.values()) + 'dev/ttyUSB0?baud=4800', _PORTS)
    if url.scheme == 'serial':
        _require(not url.netloc and len(url.path) > 1, name, value, 'serial:///dev/ttyUSB0')
        rates = ', '.join(str(rate) for rate in BAUD_RATES)
        fits = url.query in ('', *(f'baud={rate}' for rate in BAUD_RATES))
        _require(fits, name, value, f'serial:///dev/ttyUSB0?baud=RATE with one of {rates}')
    else:
        whole = url.hostname and url.port and url.path in ('', '/')
        _require(whole, name, value, f'written {_PORTS[url.scheme]}, with host and port')
    return url


def _input(
    bearing: BearingConfig, place: Input, name: str, values: Mapping[str, Any]
) -> SignalKInput | NmeaInput:
    own = {p.name: p.checked(f'{name}.{p.name}', values) for p in INPUT_PARAMETERS}
    load = place is Input.LOAD
    assumed = load and bearing.load.is_assumed
    _require(not assumed, name, own['from'], 'left out, as the load is a constant')
    timeout = bearing.inputs[place.name.lower()].timeout_ns * 1e-9
    if own['from'] == SIGNALK:
        _check_unit(bearing, place, name, 'N' if load else 'Hz', 'Signal K')
        path = own['path']
        _require(_PATH.fullmatch(path), f'{name}.path', path, 'a Signal K path, without *')
        return SignalKInput(bearing.name, place, path, own['source'], timeout)
    sentence = 'XDR' if load else 'RPM'
    kinds = ('N',) if load else ('S', 'E')
    _require(own['sentence'] == sentence, f'{name}.sentence', own['sentence'], sentence)
    rule = 'N, a force' if load else 'S for a shaft or E for an engine'
    _require(own['kind'] in kinds, f'{name}.kind', own['kind'], rule)
    rule = 'given: the name of the transducer'
    _require(own['name'] or not load, f'{name}.name', own['name'], rule)
    _check_unit(bearing, place, name, 'N' if load else 'rpm', sentence)
    fields = {key: own[key] for key in ('sentence', 'talker', 'kind', 'number', 'name')}
    return NmeaInput(bearing.name, place, timeout=timeout, **fields)


def _check_unit(bearing: BearingConfig, place: Input, name: str, unit: str, who: str) -> None:
    """The number goes to the monitor as it comes, so the monitor must know its unit."""
    if place is Input.LOAD:
        fits, actual = bearing.load.factor == 1.0, 'kN'
    else:
        factor = bearing.speed.factor
        units = [u for u in SPEED_UNITS if bearing.bearing.speed.factor(u) == factor]
        fits, actual = unit in units, units[0]
    if not fits:
        raise ConfigurationError(f"{name}.unit = '{actual}' must be {unit}, in which {who} gives it")
