"""How Sphinx builds the site: ``./go docs``."""

import shutil
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from docutils import nodes
from jupyter_cache.executors import utils as executing
from sphinx.ext import autosummary
from sphinx.util import logging

import dimersweep

project = "dimersweep"
copyright = "the dimersweep authors"
version = release = dimersweep.__version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinxcontrib.typer",
]
exclude_patterns = ["notebooks/.ipynb_checkpoints"]

mathjax_path = "mathjax/tex-chtml.js"
MATHJAX = Path(find_spec("sphinx-mathjax-offline").origin).parent / "static" / "mathjax"
MATHJAX_PARTS = ("tex-chtml.js", "input/tex/extensions", "output/chtml/fonts")  # a tenth of it: what pages can ask for

myst_enable_extensions = ["amsmath", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
myst_html_meta = {  # what a search engine shows
    "description": "Event-driven simulation of a dimer, two balls on a rod, that walks in a circle on a vibrating plate."
}
nb_execution_mode = "force"
nb_execution_excludepatterns = ["notebooks/*"]  # a test compares what is stored in them with what they give
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 600  # seconds for a cell, on a machine that does other work
# what a command prints comes in pieces, which are one text again: nb_merge_streams would break a line between them
executing.executenb = partial(executing.executenb, coalesce_streams=True)
nb_render_markdown_format = "myst"

autosummary_generate = True
# summaries are first sentences, which do not end at these
autosummary.WELL_KNOWN_ABBREVIATIONS += ("Fig.", "Figs.", "Sect.")
templates_path = ["_templates"]
autodoc_typehints = "none"  # numpydoc gives the types
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

highlight_language = "none"  # of blocks that name none

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_title = f"dimersweep {version}"
html_favicon = "_static/favicon.svg"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True


def copy_mathjax(app, error):
    """Put the program that sets formulas beside the pages, so that they need no network."""
    for part in MATHJAX_PARTS if error is None and app.builder.format == "html" else ():
        target = Path(app.outdir) / "_static" / "mathjax" / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if (MATHJAX / part).is_dir():
            shutil.copytree(MATHJAX / part, target, dirs_exist_ok=True)
        else:
            shutil.copy(MATHJAX / part, target)


def home_of(app, module, name):
    """The module that defines a function, a class or, by its class, a property: so that each has a link to its source."""
    return getattr(getattr(import_module(module), name.split(".")[0], None), "__module__", None)


def add_thumbnails(app, doctree, docname):
    """Put before each link of a section "By question" the first picture of the section that it leads to."""
    if app.config.nb_execution_mode == "off":
        return  # nothing is drawn
    for section in doctree.findall(lambda node: isinstance(node, nodes.section) and "by-question" in node["ids"]):
        for link in section.findall(nodes.reference):
            link.insert(0, next(doctree.ids[link["refid"]].findall(nodes.image)).deepcopy())


def check_alts(app, doctree, docname):
    """Warn of a picture that does not tell in words what is seen, those that cells draw among them."""
    for image in doctree.findall(nodes.image):
        if not image.get("alt"):
            logging.getLogger(__name__).warning("a picture has no alt text", location=image)


def setup(app):
    """What Sphinx calls."""
    app.connect("doctree-resolved", add_thumbnails)
    app.connect("doctree-resolved", check_alts)
    app.connect("viewcode-follow-imported", home_of)
    app.connect("build-finished", copy_mathjax)
