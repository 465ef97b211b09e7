"""``torchliner``: parse, call, print. Heavy imports wait inside the commands."""

from __future__ import annotations

import sys

try:
    import io
    import signal
    import threading
    import traceback
    from argparse import Namespace
    from collections.abc import Sequence

    from torchliner.cli.gate import passed
    from torchliner.cli.parser import BAD_INPUT, Parser
    from torchliner.cli.screen import error_text, warnings_on_stderr
    from torchliner.cli.table import COMMANDS, GROUPS
    from torchliner.io.whole_file import printable
    from torchliner.names import did_you_mean, resolve
    from torchliner.version import __version__
except KeyboardInterrupt:  # in the first tenths of a second
    sys.exit(130)

ABOUT = "Acoustic liner impedance from velocity measured just above the liner."
EXAMPLES = """examples:
  torchliner educe plane.h5 -o map.h5 --figure pictures --holes holes.csv
  torchliner liner onera --frequency 500:3000:500

torchliner COMMAND --help: its options; torchliner --version: the version."""
DONE, CHECK_FAILED, INTERRUPTED = 0, 1, 130


def overview() -> str:
    """Of all commands."""
    parts = ["usage: torchliner COMMAND ...", ABOUT]
    for title, group in GROUPS.items():
        parts.append("\n".join([f"{title}:", *(f"  {name:15s}{each.summary}" for name, each in group.items())]))
    return "\n\n".join([*parts, EXAMPLES])


def parsed(words: Sequence[str]) -> tuple[Parser, Namespace]:
    """The parser of the command that the words begin with, and its options; ends the program if they are wrong."""
    name = next((name for n in (2, 1) if (name := " ".join(words[:n])) in COMMANDS), None)
    if name is None:
        first = words[0]
        tasks = [name for name in COMMANDS if name.startswith(f"{first} ")]
        near = f" ({', '.join(tasks)})" if tasks else did_you_mean(first, [*COMMANDS])
        print(f"torchliner: unknown command {first!r}{near}\nSee torchliner --help", file=sys.stderr)
        raise SystemExit(BAD_INPUT)
    parser = Parser(name, COMMANDS[name])
    options = parser.parse([*words[len(name.split()) :]])
    options.command, options.typed = name, [*words]
    return parser, options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a check failed, 2 bad input."""
    try:
        if threading.current_thread() is threading.main_thread():  # SIGTERM leaves what Ctrl-C leaves
            signal.signal(signal.SIGTERM, signal.default_int_handler)
        if isinstance(sys.stdout, io.TextIOWrapper):  # what cannot be encoded is written out
            sys.stdout.reconfigure(errors="backslashreplace")
        words = list(sys.argv[1:] if arguments is None else arguments)
        if not words or words[0] in ("-h", "--help", "help", "--version"):
            print(f"torchliner {__version__}" if words[:1] == ["--version"] else overview(), flush=True)
            return DONE
        return _run(*parsed(words))
    except BrokenPipeError:  # the reader of a pipe has seen enough
        sys.stdout = None  # type: ignore[assignment]  # nothing to flush into
        return DONE
    except KeyboardInterrupt:
        print("torchliner: interrupted", file=sys.stderr)
        return INTERRUPTED


def _run(parser: Parser, options: Namespace) -> int:
    """The command, between the gate and what is said of its errors."""
    inputs: list[str] = []
    try:
        with warnings_on_stderr(options, parser, inputs), passed(options.command, parser.options, options) as named:
            inputs += named
            return int(resolve(f"torchliner.cli.{COMMANDS[options.command].home}")(options) or DONE)
    except BrokenPipeError:
        raise
    except Exception as error:
        if options.debug:
            traceback.print_exc()
        words = parser.in_words(error_text(error, inputs))
        print(printable(f"torchliner {options.command}: {words}"), file=sys.stderr)
        return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
