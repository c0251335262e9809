"""The site: Sphinx reads the documents as they lie in the repository, so that their links work
there too. `make site` builds it.
"""

from importlib import metadata

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

project = "Orchard"
author = "the Orchard contributors"
release = metadata.version("orchard-sim")
root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "docs/*.ipynb",
    "keyspace.md",
    "chaos/results.md",
    "bench/results.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = [".*", "runs", "build", "orchard", "tests", "**/__pycache__"]

extensions = ["myst_nb"]
myst_enable_extensions = ["attrs_inline"]
myst_heading_anchors = 4

# the notebook is run by each build, and an error in it is one of the build
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 240  # s
nb_execution_show_tb = True

html_theme = "furo"
html_title = "Orchard"
html_extra_path = ["front"]


def setup(app: Sphinx) -> None:
    """Add to Sphinx what the documents need beside its extensions."""
    app.add_lexer("mermaid", TextLexer)  # the diagrams of docs/protocol.md
