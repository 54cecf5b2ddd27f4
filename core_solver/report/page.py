"""One file of HTML with style, script and data inside."""

import html
import json
from importlib import resources

from core_solver.report.document import PageDocument

# In the order in which the browser must read them.
_SCRIPTS = (
    "data.js", "maths.js", "state.js", "bodies.js", "stage.js", "orbit.js", "sketch.js", "screen.js", "view3d.js",
    "footage.js", "topview.js", "charts.js", "panels.js", "transport.js", "main.js",
)  # fmt: skip


def render_page(document: PageDocument, block: str) -> str:
    """The whole page.

    Args:
        document: what it says.
        block: its arrays in base64.
    """
    page = _read("page.html")
    script = "\n".join(_read(name) for name in _SCRIPTS)
    parts = {
        "TITLE": html.escape(document.title),
        "STYLE": _read("style.css"),
        "DOCUMENT": _script_json(document.as_json()),
        "BLOCK": block,
        "SCRIPT": f'(() => {{\n"use strict";\n{script}\n}})();',
    }
    head, *rest = page.split("{{")
    pieces = [head]
    for piece in rest:  # one pass: what is filled in is never searched for marks again
        name, _, tail = piece.partition("}}")
        pieces += [parts[name], tail]
    return "".join(pieces)


def _script_json(value: object) -> str:
    """JSON that cannot end the script element it stands in, whatever the names in it say."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _read(name: str) -> str:
    return resources.files("core_solver.report").joinpath("page", name).read_text(encoding="utf-8")
