"""What an option is, and the parser of a command: argparse that names the nearest word for a slip.

Most options are parameters of public functions, whose signatures and docstrings are read from the source and not
imported, so that ``--help`` needs no torch.
"""

import argparse
import ast
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from torchliner import names
from torchliner.cli.kinds import COMPLEX, COUNT, FREQUENCIES, LEVEL, NUMBER, TEXT, Kind
from torchliner.io.whole_file import PICTURES
from torchliner.names import did_you_mean

PACKAGE = Path(__file__).resolve().parents[1]
CHOICES = "velocity.choices:Choices"
BAD_INPUT = 2
FILE, NAME = Kind("FILE", Path, "read"), Kind("NAME", part="named")
PICTURE, FOLDER = Kind("PICTURE", Path, "drawn", PICTURES), Kind("FOLDER", Path, "folder")
BY_TYPE: dict[str, tuple[Kind | None, Any]] = {"float": (NUMBER, None), "int": (COUNT, None), "bool": (None, None)}
BY_TYPE |= {"complex": (COMPLEX, None), "Sequence[float]": (NUMBER, "+"), "tuple[float, float]": (NUMBER, 2)}
BY_NAME = {"background": NAME, "x": NAME, "z": NAME, "points": FILE, "interval": LEVEL, "reference_phase": NUMBER}


class Option(NamedTuple):
    """An option, "--mach", or an argument, "planes"."""

    flag: str
    text: str
    kind: Kind | Iterable[str] | None = None  # of its value, or the names that it may be; None of a switch
    nargs: str | int | None = None
    default: Any = None
    required: bool = False
    many: bool = False  # may be given several times
    group: str = ""  # title in the help
    to: str = ""  # dict of the parsed options that takes it if it is given; "": an attribute of its own

    @property
    def dest(self) -> str:
        """The attribute, or the key, that it sets."""
        return self.flag.removeprefix("--").replace("-", "_")

    def add(self, parser: Any) -> None:
        """To a parser or a group of one."""
        flags = ["-o", self.flag] if self.flag == "--output" else [self.flag]
        default = argparse.SUPPRESS if self.to else [] if self.many else self.default
        about: dict[str, Any] = {"help": self.text.replace("%", "%%"), "default": default}
        if self.kind is None:
            about |= {"action": "store_true", "default": default or False}
        elif isinstance(self.kind, Kind):
            name = self.kind.metavar.split()[0] if self.flag[:1] == "-" else self.dest.upper()
            about |= {"nargs": self.nargs, "type": self.kind, "metavar": name}
        else:
            about |= {"nargs": self.nargs, "choices": list(self.kind)}
        if self.flag[:1] == "-" and self.kind is not None:
            about |= {"required": self.required, "action": "append" if self.many else "store"}
        parser.add_argument(*flags, **about)


class Of(NamedTuple):
    """Options that are parameters of a function, or fields of a dataclass."""

    home: str  # module and name, "velocity.educe:educe"
    wanted: str  # names of parameters
    group: str = ""
    kinds: Mapping[str, Any] = {}  # of parameters whose annotation does not tell it, by name
    to: str = "chosen"

    def options(self) -> list[Option]:
        """Each with the kind, default and text of its parameter."""
        return [self._option(name, *parameters(self.home)[name]) for name in self.wanted.split()]

    def _option(self, name: str, annotation: str, default: Any, text: str) -> Option:
        if name in parameters(CHOICES) and (not text or text.startswith(("as for", "as of", "one of"))):
            text = parameters(CHOICES)[name][2]
        if default is not None and default is not False and not re.search(r"\bdefault\b", text):
            text += f"; default {default:g}" if isinstance(default, float) else f"; default {default}"
        # What it can be stands in ``names``, in the plural: phase, PHASES.
        listed = getattr(names, f"{name}s".upper(), None) or getattr(names, name.upper(), None)
        by_type, nargs = BY_TYPE.get(annotation.split(" | ")[0], (TEXT, None))
        kind = self.kinds.get(name) or BY_NAME.get(name) or listed or by_type
        nargs = "+" if name == "background" else nargs if isinstance(kind, Kind) else None
        return Option(f"--{name.replace('_', '-')}", text, kind, nargs, group=self.group, to=self.to)


class Command(NamedTuple):
    """A command."""

    home: str  # module of this folder and function, which takes the parsed options and returns the exit code
    options: Sequence[Option | Of]

    @property
    def summary(self) -> str:
        """First line of the function's docstring."""
        return str(ast.get_docstring(definition(f"cli.{self.home}"))).split(". ")[0].rstrip(".")


@cache
def parsed(module: str) -> ast.Module:
    """The source of a module of this package."""
    return ast.parse((PACKAGE / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))


def definition(home: str) -> Any:
    """A function, method or class, "velocity.educe:educe", as its source has it."""
    module, path = home.split(":")
    node: Any = parsed(module)
    for name in path.split("."):
        node = next(each for each in node.body if getattr(each, "name", "") == name)
    return node


@cache
def parameters(home: str) -> dict[str, tuple[str, Any, str]]:
    """Annotation, default and text of each parameter of a function or method, or field of a dataclass."""
    node, found = definition(home), dict[str, tuple[Any, Any]]()
    if isinstance(node, ast.ClassDef):
        found = {ast.unparse(n.target): (n.annotation, n.value) for n in node.body if isinstance(n, ast.AnnAssign)}
    else:
        usual, keywords = node.args.args, node.args.kwonlyargs
        values = [None] * (len(usual) - len(node.args.defaults)) + node.args.defaults + node.args.kw_defaults
        found = {a.arg: (a.annotation, v) for a, v in zip([*usual, *keywords], values, strict=True) if a.annotation}
    # What Args says; names before one colon share a text.
    section = re.search(r"^Args:\n((?: +.*\n)+)", f"{ast.get_docstring(node)}\n", re.MULTILINE)
    texts = dict[str, str]()
    for entry in re.split(r"\n(?=    \S)", section[1].rstrip() if section else ""):
        known, _, text = entry.partition(": ")
        text = " ".join(text.split()).rstrip(".").replace("``", "")
        texts.update(dict.fromkeys(known.replace(",", " ").split(), text))
    module = home.partition(":")[0]
    return {name: (ast.unparse(kind), _literal(v, module), texts.get(name, "")) for name, (kind, v) in found.items()}


def _literal(default: ast.expr | None, module: str) -> Any:
    """The value of a literal, or of a constant of the module; None of all else."""
    if isinstance(default, ast.Name):
        constants = {ast.unparse(n.targets[0]): n.value for n in parsed(module).body if isinstance(n, ast.Assign)}
        default = constants.get(default.id)
    return default.value if isinstance(default, ast.Constant) else None


def spelled(keys: Iterable[str]) -> str:
    """Options by their attributes, as they are typed: "--in-situ, --quiet"."""
    return ", ".join(f"--{key.replace('_', '-')}" for key in keys)


PRINTING = (
    Option("--json", "print JSON instead of a table"),
    Option("--verbose", "print all there is, and every warning"),
    Option("--quiet", "no progress bar, no warnings"),
    Option("--debug", "print the traceback of an error"),
)
TAKEN = ("chosen", "reading", "facts")  # dicts of given options


class Parser(argparse.ArgumentParser):
    """Of one command."""

    def __init__(self, name: str, command: Command) -> None:
        super().__init__(prog=f"torchliner {name}", description=f"{command.summary}.", allow_abbrev=False)
        # No option begins with a minus and a digit: -0.17-0.07j is an impedance, not an option.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        every = [one for each in command.options for one in ([each] if isinstance(each, Option) else each.options())]
        self.options = sorted([*every, *PRINTING], key=lambda each: each.to == "reading")  # that of the files last
        groups: dict[str, Any] = {"": self}
        for each in self.options:
            if each.group not in groups:
                groups[each.group] = self.add_argument_group(each.group)
            each.add(groups[each.group])
        given = [each.dest.upper() + " ..." * (each.nargs == "+") for each in self.options if each.flag[:1] != "-"]
        needed = [f"{each.flag} {each.kind.metavar}" for each in self.options if each.required]  # type: ignore[union-attr]
        self.usage = " ".join([self.prog, "[options]", *given, *needed])

    def parse(self, words: list[str]) -> argparse.Namespace:
        """The options; those that go into a dict stand there by name, if they are given."""
        found = self.parse_args(words)
        for name in TAKEN:
            setattr(found, name, {})
        for each in self.options:
            value = getattr(found, each.dest, None)
            if each.kind is FREQUENCIES and value is not None:  # ranges may overlap
                setattr(found, each.dest, list(dict.fromkeys(chain(*value))))
            if each.to and hasattr(found, each.dest):
                getattr(found, each.to)[each.dest] = getattr(found, each.dest)
        return found

    def error(self, message: str) -> NoReturn:
        """Print the message with the nearest known word, and where to find help; exit with 2."""
        if wrong := re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message):
            message += did_you_mean(wrong[1], [word.strip(" '") for word in wrong[2].split(",")])
        if extra := re.match(r"unrecognized arguments: (.*)", message, re.DOTALL):
            known = [*self._option_string_actions]
            words = [w + did_you_mean(w.split("=")[0], known) * w.startswith("-") for w in extra[1].split()]
            message = f"unknown option or argument: {', '.join(words)}"
        print(f"{self.prog}: {message}\nSee {self.prog} --help", file=sys.stderr)
        sys.exit(BAD_INPUT)
