"""Sphinx: the documentation as one site that needs no network, neither to build nor to read.

Pages of Markdown (MyST), the gallery from ``gallery/plot_*.py``, the reference from docstrings.
``make docs`` builds it with warnings as errors.
"""

from __future__ import annotations

import re
import sys
import warnings
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE)]

from reference import write_reference  # noqa: E402  the path stands above

import torchliner  # noqa: E402

project, author = "torchliner", "The torchliner developers"
copyright = author
version = release = torchliner.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["build", "examples/*", "gallery/*", "notebooks/*", "package.md"]

html_theme = "furo"
html_title = f"torchliner {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_js_files = ["access.js"]
html_copy_source = False
html_show_sourcelink = False

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "description"
autodoc_typehints_format = "short"
autodoc_typehints_description_target = "documented"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "Array", "Liner", "Parameter", "Real")}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 60
add_module_names = False
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_custom_sections = [("Source", "notes_style")]

html_math_renderer = "mathml"


sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "pictures",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "write_computation_times": False,
    "capture_repr": (),
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "abort_on_example_error": True,
    "reset_modules": ("matplotlib", "gallery_style.apply"),
}

# Warnings of the gallery's scripts are shown with their pictures, without the paths of a machine.
warnings.formatwarning = lambda message, category, *_, **__: f"{category.__name__}: {message}\n"

# What lies beside docs/ in the repository has a page here or is named, not linked.
BESIDE = {
    "data/README.md": "site/data.md",
    "CONTRIBUTING.md": "site/extend.md",
    "README.md": "index.md",
}


def beside_the_docs(app: Any, page: str, text: list[str]) -> None:
    """Links to files beside docs/ lead to the pages that show them."""
    up = "../" * page.count("/")
    for file, shown in BESIDE.items():
        text[0] = re.sub(rf"\]\((\.\./)+{re.escape(file)}\)", f"]({up}{shown})", text[0])


APART = re.compile(r"(``.*?``|:\w+:`.*?`|^ *>>>.*?$)", re.DOTALL | re.MULTILINE)


def plain_text(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """|v| is an absolute value, which reStructuredText takes for a substitution; names of arguments
    that share a line stand on one line, as Napoleon wants them; FILE:/name is no address."""
    text = re.sub(r"^( +[\w, ]+,)\n +(?=[\w, ]+: )", r"\1 ", "\n".join(lines), flags=re.MULTILINE)
    parts = APART.split(text)
    parts[::2] = [part.replace("|", "\\|").replace("FILE:", "FILE\\:") for part in parts[::2]]
    lines[:] = "".join(parts).split("\n")


COMPLEX = re.compile(r"(\d[\d.]*-\d[\d.]*j)")


def whole_numbers(app: Any, document: Any, page: str) -> None:
    """A complex number is a span, which site.css keeps on one line: browsers break at a hyphen."""
    from docutils import nodes

    for paragraph in document.findall(nodes.paragraph):
        for text in list(paragraph.findall(nodes.Text)):
            parts: list[Any] = [nodes.Text(part) for part in COMPLEX.split(text)]
            if len(parts) > 1 and not isinstance(text.parent, nodes.literal):
                parts[1::2] = [nodes.inline("", "", n, classes=["complex"]) for n in parts[1::2]]
                text.parent.replace(text, parts)


def mathml(writer: Any, node: Any) -> None:
    """A formula as MathML, which browsers draw without a script; docutils translates it."""
    from docutils import nodes
    from docutils.utils.math.latex2mathml import tex2mathml

    writer.body.append(tex2mathml(node.astext(), as_block=isinstance(node, nodes.math_block)))
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """The reference's pages, links, numbers and formulas."""
    write_reference(HERE / "api")
    app.connect("source-read", beside_the_docs)
    app.connect("autodoc-process-docstring", plain_text, priority=400)  # before Napoleon
    app.connect("doctree-resolved", whole_numbers)
    app.add_html_math_renderer("mathml", (mathml, None), (mathml, None))
