"""``torchliner``: parse, call, print. Heavy imports wait inside the commands."""

import ctypes
import io
import signal
import sys
import threading
import traceback
import warnings
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from torchliner.cli.gate import passed
from torchliner.cli.options import BAD_INPUT, Parser
from torchliner.cli.table import COMMANDS, GROUPS
from torchliner.io.whole_file import printable
from torchliner.names import __version__, did_you_mean, resolve

ABOUT = "Acoustic liner impedance from velocity measured just above the liner."
MORE = "torchliner COMMAND --help: its options; torchliner --version: the version."
DONE, CHECK_FAILED, INTERRUPTED = 0, 1, 130
EXPECTED = (ValueError, TypeError, OSError, ImportError, RuntimeError, MemoryError)
PLANNED = (DeprecationWarning, PendingDeprecationWarning, FutureWarning)  # by libraries
WARNINGS_SHOWN = 3  # without --verbose
M_ARENA_MAX = -8  # of malloc.h


def overview() -> str:
    """Of all commands."""
    parts = ["usage: torchliner COMMAND ...", ABOUT]
    for (_, title), group in GROUPS.items():
        parts.append("\n".join([f"{title}:", *(f"  {name:15s}{COMMANDS[name].summary}" for name in group)]))
    return "\n\n".join([*parts, MORE])


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
    with suppress(OSError, AttributeError, TypeError):  # of glibc: more than two arenas for the threads keep 10 % more
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 2)
    try:
        with warnings_on_stderr(options), passed(options.command, parser.options, options) as named:
            inputs += named
            return int(resolve(f"torchliner.cli.{COMMANDS[options.command].home}")(options) or DONE)
    except BrokenPipeError:
        raise
    except Exception as error:
        if options.debug:
            traceback.print_exc()
        print(printable(f"torchliner {options.command}: {error_text(error, inputs)}"), file=sys.stderr)
        return BAD_INPUT


def error_text(error: Exception, inputs: Sequence[str]) -> str:
    """One message of an error; of one that was not foreseen with the first input, which a library does not name."""
    text, lead = str(error) or type(error).__name__, "".join(f"{name}: " for name in inputs[:1])
    if isinstance(error, EXPECTED) and not isinstance(error, RecursionError):
        return text
    fault = "this is a fault of torchliner: please report it, with the file and with what --debug prints"
    return f"{lead}{type(error).__name__}: {text.splitlines()[0]}; {fault}"


@contextmanager
def warnings_on_stderr(options: Namespace) -> Iterator[None]:
    """Each warning once, what moves Z most first: three, all with --verbose, none with --quiet; the answer has the
    level check."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore" if options.quiet else "always")
        try:
            yield
        finally:
            notes = {str(note): note for note in getattr(options, "notes", ())}  # of the result
            sizes = {text: getattr(note, "size", None) for text, note in notes.items()}
            texts = dict.fromkeys(str(each.message) for each in caught if not issubclass(each.category, PLANNED))
            told = [t for t in texts if options.verbose or getattr(notes.get(t), "code", "") != "level-check"]
            every = sorted(told, key=lambda text: -(sizes.get(text) or 0.0))
            shown = every if options.verbose else every[:WARNINGS_SHOWN]
            for text in shown:
                lead = "" if sizes.get(text) is None else f" (may move Z by {sizes[text]:.2g})"
                print(f"warning{lead}: {printable(text)}", file=sys.stderr)
            if len(every) > len(shown):
                print(f"warning: {len(every) - len(shown)} more; --verbose prints them", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
