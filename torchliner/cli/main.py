"""``torchliner``: parse, call, print. Heavy imports wait inside the commands."""

from __future__ import annotations

import sys

try:
    import argparse
    import importlib
    import inspect
    import signal
    import threading
    import traceback
    from collections.abc import Sequence
    from contextlib import nullcontext, redirect_stdout
    from typing import Any

    from torchliner.cli.gate import passed
    from torchliner.cli.kinds import PLANE, Command
    from torchliner.cli.options import PRINTING, READING, given
    from torchliner.cli.output import Printable, error_text, warnings_on_stderr
    from torchliner.cli.parser import BAD_INPUT, Parser
    from torchliner.io.whole_file import printable
    from torchliner.version import __version__
except KeyboardInterrupt:  # in the first tenths of a second
    sys.exit(130)

GROUPS = {  # title: command: module, summary
    "educe an impedance from velocity above the liner": {
        "educe": ("velocity", "impedance map of one or several velocity planes"),
        "replay": ("velocity", "the same under any incident wave, with the reflected signal"),
        "ldv": ("bursts", "bursts of laser Doppler stations: check, convert, educe"),
        "audit": ("studies", "how far each open choice moves the impedance"),
        "height": ("studies", "impedance over height, and which height to take"),
        "compare": ("studies", "difference of two maps, by cell and for the liner"),
        "compare-models": ("studies", "several models of the liner on one plane, in one pass"),
        "validate": ("velocity", "every rule beside the reference impedance of resolved cases"),
    },
    "measure an impedance from pressure": {
        "insitu": ("pressure", "facesheet and backplate pressure, microphones in the duct"),
        "kt": ("pressure", "microphones along a lined duct, by wavenumber or by fit"),
    },
    "model a liner or a duct": {
        "liner": ("models", "geometry, resonance and impedance of a liner"),
        "duct": ("models", "sound field and modes of a lined duct with flow"),
        "sensitivity": ("fits", "change of Z with each parameter of a liner; tolerances"),
        "ir-tdibc": ("models", "impedance over level from the incident wave alone"),
        "calibrate": ("fits", "parameters of a liner fitted to known impedances"),
        "identify": ("fits", "response of a liner to |v| found from runs of known impedance"),
    },
    "files": {
        "demo": ("files", "educe two planes that come with the program"),
        "info": ("files", "describe and check a velocity plane"),
        "convert": ("files", "write a plane file from files of any format"),
        "reduce": ("velocity", "moments of a plane: any liner later, without the data"),
        "export": ("models", "poles and residues of a map, for solvers in the time domain"),
        "run": ("files", "a campaign: planes, liners, choices; resumable"),
        "follow": ("velocity", "impedance and its interval while a plane is being written"),
        "report": ("files", "one page of a result, to read, attach and repeat"),
    },
}
COMMANDS = {name: about for group in GROUPS.values() for name, about in group.items()}
OVERVIEW = "\n\n".join(
    "\n".join([f"{title}:", *(f"  {name:15s}{text}" for name, (_, text) in group.items())])
    for title, group in GROUPS.items()
)
SHOWN = """examples:
  torchliner educe plane.h5 -o map.h5 --figure pictures --holes holes.csv
  torchliner liner onera --frequency 500:3000:500

torchliner COMMAND --help: its options; --help-all: all of them, of ldv
and duct behind their task."""
COMPLETION = "--print-completion"  # of a shell; needs shtab
DONE, CHECK_FAILED, INTERRUPTED = 0, 1, 130


def build_parser(only: str | None = None, whole: bool = True) -> tuple[Parser, dict[str, Parser]]:
    """The top parser and those of the commands.

    Args:
        only: a command, or what stands in its place, to leave out the options of the others.
        whole: the help has the options that wait for --help-all.
    """
    top = Parser(
        prog="torchliner",
        usage="torchliner [-h] [--version] COMMAND ...",
        description=f"Acoustic liner impedance from velocity measured just above the liner.\n\n{OVERVIEW}",
        epilog=SHOWN,
    )
    version = f"torchliner {__version__}"
    top.add_argument("--version", action="version", version=version, help="print the version and exit")
    text = argparse.SUPPRESS  # of the commands, which the overview lists
    if only == COMPLETION:
        import shtab

        shtab.add_argument_to(top, COMPLETION)
        text = "command"
    commands = top.add_subparsers(dest="command", metavar="COMMAND", help=text, prog="torchliner")
    parsers = {}
    for name, (module, summary) in COMMANDS.items():
        about: dict[str, Any] = {"help": summary, "description": f"{summary[0].upper()}{summary[1:]}.", "whole": whole}
        if only not in (None, COMPLETION, name):
            commands.add_parser(name, **about)
            continue
        command = importlib.import_module(f"torchliner.cli.{module}").COMMANDS[name]
        if not isinstance(command, dict):  # of tasks
            parsers[name] = _add(commands, name, command, about)
            continue
        parsers[name] = commands.add_parser(name, **about)
        tasks = parsers[name].add_subparsers(dest="task", metavar="TASK", required=True, prog=parsers[name].prog)
        for task, each in command.items():
            text = inspect.getdoc(each.run) or ""
            _add(tasks, f"{name} {task}", each, about | {"help": text.split(".")[0], "description": text})
    return top, parsers


def _add(parsers: Any, name: str, command: Command, about: dict[str, Any]) -> Parser:
    examples = "\n".join(["examples:", *(f"  torchliner {name} {words}".rstrip() for words in command.examples)])
    parser: Parser = parsers.add_parser(name.split()[-1], **about, epilog=examples)
    reading = READING if any(each.kind is PLANE for each in command.options) else []
    parser.add_options([*command.options, *PRINTING, *command.chosen, *reading])
    parser.set_defaults(declared=command)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a check failed, 2 bad input."""
    try:
        if threading.current_thread() is threading.main_thread():  # SIGTERM leaves what Ctrl-C leaves
            signal.signal(signal.SIGTERM, signal.default_int_handler)
        words = list(sys.argv[1:] if arguments is None else arguments)
        if words[:1] == ["help"]:
            words = [*words[1:], "--help"]
        first = COMPLETION if COMPLETION in words else next((word for word in words if word[:1] != "-"), "")
        top, _ = build_parser(first, whole="--help-all" in words)
        options, extras = top.parse_known_args(words)
        if options.command is None:
            if extras and extras != ["--help-all"]:
                top.refuse(extras)
            top.print_help()
            return DONE
        parser = top.chosen(options)
        if extras:
            parser.refuse(extras)
        options.typed = words
        return _run(parser, options)
    except KeyboardInterrupt:
        print("torchliner: interrupted", file=sys.stderr)
        return INTERRUPTED


def _run(parser: Parser, options: argparse.Namespace) -> int:
    """The command, between the gate and what is said of its errors."""
    inputs: list[str] = []
    printed = nullcontext() if sys.stdout is None else redirect_stdout(Printable(sys.stdout))  # type: ignore[type-var]
    try:
        with warnings_on_stderr(options, parser, inputs), printed, passed(parser, options) as named:
            inputs += named
            options.chosen, options.reading = given(options, options.declared.chosen), given(options, READING)
            code = options.declared.run(options) or DONE
            if sys.stdout is not None:
                sys.stdout.flush()  # here, where a broken pipe is no error
            return int(code)
    except BrokenPipeError:  # the reader of a pipe has seen enough
        sys.stdout = None  # type: ignore[assignment]  # nothing to flush into
        return DONE
    except Exception as error:
        if getattr(options, "debug", False):
            traceback.print_exc()
        words = parser.in_words(error_text(error, inputs))
        print(printable(f"torchliner {options.command}: {words}"), file=sys.stderr)
        return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
