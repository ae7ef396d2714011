# SPDX-License-Identifier: Apache-2.0
"""The process of the node: its environment, its executor, signals and exit code."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from stickslip_monitor.errors import ConfigurationError, RosError, StickslipError, program_fault
from stickslip_monitor.host import ServiceManager, end_signals, unblocked_log
from stickslip_monitor.monitor.clip_recorder import ClipStore
from stickslip_monitor.monitor.parameter_file import NODE_NAME, load_parameters
from stickslip_monitor.monitor.parameters import ClipConfig
from stickslip_monitor.monitor.value_check import require_rule
from stickslip_monitor.ros.inputs import ROS_FAULTS
from stickslip_monitor.ros.node import MonitorNode, ros_error_text
from stickslip_monitor.ros.other_nodes import without_log_files
from stickslip_monitor.safe_files import printable

MAX_WAIT = 0.2
"""Longest wait of the executor [s]: between two waits signals are noticed, and the watchdog is notified."""
EXECUTOR = 'STICKSLIP_MONITOR_EXECUTOR'
"""The environment variable that chooses the executor: ``events`` or ``single``."""


def make_executor() -> Executor:
    """Make the executor that wakes for work only, where this ROS 2 has it (from Kilted on).

    Else, and with ``STICKSLIP_MONITOR_EXECUTOR=single``, rclpy's common one: the other is experimental.

    Raises:
        ConfigurationError: The environment variable has another value than ``single`` or ``events``.
    """
    choice = os.environ.get(EXECUTOR, 'events')
    require_rule(choice in ('events', 'single'), EXECUTOR, choice, 'events or single')
    if choice == 'single':
        return SingleThreadedExecutor()
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def _spin_node(node: MonitorNode, signals: Sequence[int], errors: int) -> None:
    """Spin the node until a signal has been noted or ROS is shut down; report exceptions of callbacks.

    The service manager is notified of the start, of life, and of the end.

    Args:
        node: The node.
        signals: Signals noted so far, to which a handler adds.
        errors: File descriptor to which Python writes the frames of a crash.

    Raises:
        ConfigurationError: The environment asks for an unknown executor (:func:`make_executor`).
    """
    executor, manager = make_executor(), ServiceManager()
    faulthandler.enable(errors)  # the executor has it write where nobody hands on what is left
    executor.add_node(node)
    manager.notify('READY=1')
    try:
        while rclpy.ok() and not signals:
            manager.beat()
            try:
                # Python runs its signal handlers between waits: none may last.
                executor.spin_once(MAX_WAIT)
            except ExternalShutdownException:
                return
            except Exception as error:
                # Up to ROS 2 Jazzy an invalid lifecycle request raises out of spin.
                if not rclpy.ok():
                    return
                node.report_exception(error)
    finally:
        manager.notify('STOPPING=1')
        executor.shutdown()


def _require_security() -> None:
    """Set ``ROS_SECURITY_STRATEGY`` to enforce security where it is asked for, unless it has a value.

    Without it ROS 2 would run without keys.

    Raises:
        RosError: No keystore is named.
    """
    if os.environ.get('ROS_SECURITY_ENABLE') == 'true':
        if not os.environ.get('ROS_SECURITY_KEYSTORE'):
            raise RosError('ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE names no keystore')
        os.environ.setdefault('ROS_SECURITY_STRATEGY', 'Enforce')


def _make_node(args: Sequence[str], store: Callable[[ClipConfig], ClipStore] | None) -> MonitorNode:
    """Start ROS, and make the node; ROS is left running where that fails.

    ``store`` makes what takes event clips; ``None`` for none.

    Raises:
        StickslipError: The arguments, a parameter or a name cannot be used.
    """
    problem = 'the ROS arguments cannot be used'
    try:
        rclpy.init(args=without_log_files(args), signal_handler_options=SignalHandlerOptions.NO)
        problem = 'the node cannot be created'
        with warnings.catch_warnings():
            # What cannot be created is half created, and rclpy warns of the other half.
            warnings.simplefilter('ignore', RuntimeWarning)
            return MonitorNode(store)
    except ConfigurationError as error:
        raise ConfigurationError(_parameter_slip(args) or str(error)) from error
    except StickslipError:
        raise
    except (*ROS_FAULTS, rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError) as error:
        # Where a file cannot be read, or has an empty list, rcl names neither the line nor the parameter.
        slip = _parameter_slip(args) if '--params-file' in args else ''
        raise RosError(slip or f'{problem}: {ros_error_text(error)}') from error


def _parameter_slip(args: Sequence[str]) -> str:
    """Return the error text on how parameters were given; '' where nothing is wrong.

    None were given, an option is out of place, a file cannot be read or is not for this node, or a list is
    empty or nested. The files are read.
    """
    inside, files, given, name, space = False, list[str](), False, NODE_NAME, ''
    for number, word in enumerate(args):
        inside = word == '--ros-args' or (inside and word != '--')
        value = args[number + 1] if number + 1 < len(args) else ''
        if word in ('--params-file', '-p', '--param') and not inside:
            return (
                f'{word} has no effect outside --ros-args: write monitor --ros-args {word} {value}'.rstrip()
            )
        given |= word in ('-p', '--param')
        if word == '--params-file':
            files.append(value)
        if value.startswith('__ns:='):
            space = f'/{value.removeprefix("__ns:=").strip("/")}'.rstrip('/')
        if value.startswith('__node:='):
            name = value.removeprefix('__node:=')
    if not files:
        return '' if given else 'no parameters are given: monitor --ros-args --params-file FILE'
    parameters, faults = dict[str, object](), list[str]()
    for path in files:
        try:
            parameters |= load_parameters(path, f'{space}/{name}')
        except ConfigurationError as error:
            faults.append(str(error))
    if len(faults) == len(files):
        return faults[0]
    return next(
        (text for key, value_list in parameters.items() if (text := _list_fault(key, value_list))), ''
    )


def _list_fault(key: str, listed: object) -> str:
    """Return the error text on a list that rcl cannot read; '' for any other value of a parameter.

    It cannot read an empty list, nor one of lists.
    """
    if listed == []:
        return f'{key} = [] is empty: give it at least one entry, or leave it out'
    if not isinstance(listed, list) or not all(isinstance(item, list) for item in listed):
        return ''
    flat = [number for pair in listed for number in pair]
    return f'{key} is a list of lists, which ROS 2 does not read: write {key}: {flat}'


def _run_node(args: Sequence[str], store: Callable[[ClipConfig], ClipStore] | None, errors: int) -> None:
    """Make the node, start it, and spin until a signal or the end of ROS; take it and ROS down in any case.

    Signals that end the program are noted meanwhile, and ignored from then on. Security is enforced where the
    environment asks for it (:func:`_require_security`). ``errors`` is the file descriptor to which Python
    writes the frames of a crash.

    Raises:
        StickslipError: The node cannot be made or started.
    """
    # Noted, not raised: an interrupt in the middle of an import prints a traceback of its own.
    # ROS's own handlers stay out: they take ROS down in a thread, under the node's feet.
    signals: list[int] = []
    ends = end_signals()
    for number in ends:
        signal.signal(number, lambda number, _: signals.append(number))
    _require_security()
    node = None
    try:
        node = _make_node(args, store)
        if node.config.autostart and not signals:
            node.start()
        _spin_node(node, signals, errors)
    finally:
        # A second Ctrl-C (a launch system sends one too) must not break the way out.
        for number in ends:
            signal.signal(number, signal.SIG_IGN)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def main(args: Sequence[str] | None = None, store: Callable[[ClipConfig], ClipStore] | None = None) -> int:
    """Run the node until a signal ends it; print a failure as one line ``ERROR: ...``.

    With ``--traceback`` the traceback of a fault comes before it. Signals that end a program stay ignored
    afterwards.

    Args:
        args: Arguments without the program's name; those of the process if ``None``.
        store: Makes what takes event clips; ``None`` for none.

    Returns:
        0 after Ctrl-C, a termination signal or the end of the terminal; 2 where the node cannot be made or
        started, as with a bad configuration; 3 after a fault of the program.
    """
    args = sys.argv if args is None else args
    with unblocked_log() as errors:
        try:
            _run_node(args, store, errors)
        except (KeyboardInterrupt, ExternalShutdownException):
            return 0
        except StickslipError as error:
            code, text = 2, str(error)
        except Exception as error:
            if '--traceback' in args:
                traceback.print_exc()
            code, text = 3, printable(program_fault(error))
        else:
            return 0
        print(f'ERROR: {text}', file=sys.stderr)  # noqa: T201
    return code
