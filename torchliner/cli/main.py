"""``torchliner``: parse, call, print. Heavy imports wait inside the commands."""

from __future__ import annotations

import sys

try:
    import argparse
    import importlib
    import signal
    import threading
    import traceback
    from collections.abc import Iterator, Sequence
    from contextlib import contextmanager
    from typing import Any

    from torchliner.cli.gate import passed
    from torchliner.cli.messages import error_text, printable_output, warnings_on_stderr
    from torchliner.cli.parser import BAD_INPUT, SHELLS, Parser, PrintCompletion
    from torchliner.io.whole_file import printable
    from torchliner.version import __version__
except KeyboardInterrupt:  # in the first tenths of a second
    sys.exit(130)

GROUPS = {
    "educe an impedance from velocity above the liner": {
        "educe": "impedance map of one or several velocity planes",
        "replay": "the same under any incident wave, with the reflected signal",
        "ldv": "bursts of laser Doppler stations: check, convert, educe",
        "audit": "how far each open choice moves the impedance",
        "height": "impedance over height, and which height to take",
        "compare": "difference of two maps, by cell and for the liner",
        "compare-models": "several models of the liner on one plane, in one pass",
        "validate": "every rule beside the reference impedance of resolved cases",
    },
    "measure an impedance from pressure": {
        "insitu": "facesheet and backplate pressure, microphones in the duct",
        "kt": "microphones along a lined duct, by wavenumber or by fit",
    },
    "model a liner or a duct": {
        "liner": "geometry, resonance and impedance of a liner",
        "duct": "sound field and modes of a lined duct with flow",
        "sensitivity": "change of Z with each parameter of a liner; tolerances",
        "ir-tdibc": "impedance over level from the incident wave alone",
        "calibrate": "parameters of a liner fitted to known impedances",
        "identify": "response of a liner to |v| found from runs of known impedance",
    },
    "files": {
        "demo": "educe two planes that come with the program",
        "info": "describe and check a velocity plane",
        "convert": "write a plane file from files of any format",
        "reduce": "moments of a plane: any liner later, without the data",
        "export": "poles and residues of a map, for solvers in the time domain",
        "run": "a campaign: planes, liners, choices; resumable",
        "follow": "impedance and its interval while a plane is being written",
        "report": "one page of a result, to read, attach and repeat",
    },
}
COMMANDS = {name: summary for group in GROUPS.values() for name, summary in group.items()}
OVERVIEW = "\n\n".join(
    "\n".join([f"{title}:", *(f"  {name:15s}{text}" for name, text in group.items())])
    for title, group in GROUPS.items()
)
SHOWN = """examples:
  torchliner educe plane.h5 -o map.h5 --figure pictures --holes holes.csv
  torchliner liner onera --frequency 500:3000:500

torchliner COMMAND --help: its options; --help-all: all of them, of ldv
and duct behind their task."""
DONE, CHECK_FAILED, INTERRUPTED = 0, 1, 130


def build_parser(only: str | None = None) -> tuple[Parser, dict[str, Parser]]:
    """The top parser and those of the commands; if ``only`` is one, without options of others."""
    top = Parser(
        prog="torchliner",
        usage="torchliner [-h] [--version] COMMAND ...",
        description=f"Acoustic liner impedance from velocity measured just above the liner.\n\n{OVERVIEW}",
        examples=SHOWN,
    )
    version = f"torchliner {__version__}"
    top.add_argument("--version", action="version", version=version, help="print the version and exit")
    text = f"print the completion script of {', '.join(SHELLS)} and exit"
    top.add_argument("--print-completion", action=PrintCompletion, choices=SHELLS, metavar="SHELL", help=text)
    commands = top.add_subparsers(dest="command", metavar="COMMAND", help=argparse.SUPPRESS, prog="torchliner")
    parsers = {}
    for name, summary in COMMANDS.items():
        about: dict[str, Any] = {"help": summary, "description": f"{summary[0].upper()}{summary[1:]}."}
        if only in COMMANDS and only != name:
            commands.add_parser(name, **about)
            continue
        command = _module(name)
        if hasattr(command, "TASKS"):
            parsers[name] = commands.add_parser(name, **about)
            tasks = parsers[name].add_subparsers(dest="task", metavar="TASK", required=True, prog=parsers[name].prog)
            for task, (text, description, options, examples) in command.TASKS.items():
                told: dict[str, Any] = {
                    "help": text,
                    "description": description,
                    "examples": _examples(f"{name} {task}", examples),
                }
                tasks.add_parser(task, **told).add_options(options)
        else:
            parsers[name] = commands.add_parser(name, **about, examples=_examples(name, command.EXAMPLES))
            parsers[name].add_options(command.OPTIONS)
    return top, parsers


def _module(command: str) -> Any:
    return importlib.import_module(f"torchliner.cli.{command.replace('-', '_')}")


def _examples(command: str, examples: Sequence[str]) -> str:
    return "\n".join(["examples:", *(f"  torchliner {command} {words}".rstrip() for words in examples)])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a check failed, 2 bad input."""
    try:
        if threading.current_thread() is threading.main_thread():  # SIGTERM leaves what Ctrl-C leaves
            signal.signal(signal.SIGTERM, signal.default_int_handler)
        words = list(sys.argv[1:] if arguments is None else arguments)
        if words[:1] == ["help"]:
            words = [*words[1:], "--help"]
        top, _ = build_parser(*words[:1])
        options, extras = top.parse_known_args(words)
        if options.command is None:
            if extras:
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
    try:
        command = _module(options.command)
        with (
            warnings_on_stderr(options, parser, inputs),
            printable_output(),
            passed(parser, options) as named,
            _figures_as_asked(options),
        ):
            inputs += named
            code = int(command.run(options))
            if sys.stdout is not None:
                sys.stdout.flush()  # here, where a broken pipe is no error
            return code
    except BrokenPipeError:  # the reader of a pipe has seen enough
        sys.stdout = None  # type: ignore[assignment]  # nothing to flush into
        return DONE
    except Exception as error:
        if getattr(options, "debug", False):
            traceback.print_exc()
        words = parser.in_words(error_text(error, inputs))
        print(printable(f"torchliner {options.command}: {words}"), file=sys.stderr)
        return BAD_INPUT


@contextmanager
def _figures_as_asked(options: argparse.Namespace) -> Iterator[None]:
    """Within the block figures are as wide as ``--figure-width`` says."""
    if (width := getattr(options, "figure_width", None)) is None:
        yield
        return
    from torchliner.report.figure import figure_style

    with figure_style(width):
        yield


if __name__ == "__main__":
    sys.exit(main())
