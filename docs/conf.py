"""The site of these documents, built by `sphinx-build -W -n docs docs/_build` (CONTRIBUTING.md).

Nothing is fetched, neither by the build nor by a page that is read.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # the API is that of this tree
os.environ.setdefault("OMP_NUM_THREADS", "1")

from docutils import nodes  # noqa: E402
from docutils.utils.math.latex2mathml import tex2mathml  # noqa: E402
from pygments.lexers.special import TextLexer  # noqa: E402

from anaplot.version import __version__  # noqa: E402

project = "anaplot"
release = version = __version__
language = "en"
smartquotes = False  # of a program: -- is no dash

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "notebooks"]
templates_path: list[str] = []

myst_enable_extensions = ["dollarmath"]
myst_dmath_double_inline = True
myst_heading_anchors = 3
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
napoleon_google_docstring = False
python_maximum_signature_line_length = 88
# types of numpy and of the rooms inside have no page here; links between pages are checked
nitpick_ignore_regex = [(r"py:.*", r".*")]

html_theme = "furo"
html_title = "anaplot"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = html_show_sourcelink = html_domain_indices = False
html_show_sphinx = False
html_show_copyright = False


def _mathml(block: bool) -> Callable[[Any, nodes.Element], None]:
    """Return what writes a formula as MathML, which browsers read without a script."""

    def visit(translator: Any, node: nodes.Element) -> None:
        written = tex2mathml(node.astext(), as_block=block)
        # a wide formula scrolls sideways; none has a bar of its own for its height
        tag, style = ("div", ' style="overflow-y: hidden"') if block else ("span", "")
        translator.body.append(f'<{tag} class="math"{style}>{written}</{tag}>')
        raise nodes.SkipNode

    return visit


def setup(app: Any) -> dict[str, bool]:
    """Write formulas by docutils' own converter: no script from elsewhere, no further package."""
    app.add_lexer("csv", TextLexer)
    app.add_html_math_renderer("mathml", (_mathml(False), None), (_mathml(True), None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
