"""Every English string that the add-on shows: what Blender draws of registered classes, and literals in the sources."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Calls whose literal arguments Blender translates when it draws them, and the arguments' names.
DRAWN = {"label": ("text",), "operator": ("text",), "prop": ("text",), "menu": ("text",), "column": ("heading",),
         "row": ("heading",), "prop_search": ("text",), "popup_menu": ("title",), "operator_menu_enum": ("text",),
         "progress": ("text",), "template_list": (), "invoke_props_dialog": ("title", "confirm_text")}  # fmt: skip
# Functions of ours that look a literal up themselves.
LOOKED_UP = {"rpt_", "iface_", "tip_", "n_"}


def class_strings(bpy: Any, classes: tuple[type, ...]) -> set[str]:
    """Labels and tooltips of the classes and of their properties."""
    found: set[str] = set()
    for cls in classes:
        rna: Any = cls.bl_rna  # pyright: ignore[reportAttributeAccessIssue]
        kind = rna.base.identifier if rna.base is not None else ""
        if kind in {"Operator", "Panel", "FileHandler", "Menu"}:
            found.add(cls.bl_label)  # pyright: ignore[reportAttributeAccessIssue]
        if kind == "Operator":
            module, name = cls.bl_idname.split(".")  # pyright: ignore[reportAttributeAccessIssue]
            rna = getattr(getattr(bpy.ops, module), name).get_rna_type()
            found.add(rna.description)
        own = set(rna.properties.keys()) - set(rna.base.properties.keys() if rna.base else ())
        for identifier in own:
            found |= set(_property_strings(rna.properties[identifier]))
    return {text for text in found if text.strip()}


def _property_strings(prop: Any) -> Iterator[str]:
    if prop.is_hidden or prop.identifier in {"filepath", "directory", "files", "filename_ext", "filter_glob", "name"}:
        return
    if prop.name != prop.identifier:  # otherwise it has no name, because nobody sees it
        yield prop.name
    yield prop.description
    if prop.type == "ENUM":
        for item in prop.enum_items_static:
            yield item.name
            yield item.description


def source_strings(folder: Path) -> set[str]:
    """Literals in layout calls, in look-ups and in lists of enum items that are made at run time."""
    found: set[str] = set()
    for file in sorted(folder.rglob("*.py")):
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call):
                found |= set(_call_strings(call))
    return {text for text in found if text.strip()}


def _call_strings(call: ast.Call) -> Iterator[str]:
    name = (
        call.func.attr
        if isinstance(call.func, ast.Attribute)
        else call.func.id
        if isinstance(call.func, ast.Name)
        else ""
    )
    if name in LOOKED_UP and call.args:
        yield from _literals(call.args[0])
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    if name in DRAWN and not _is_false(given.get("translate")):
        for argument in DRAWN[name]:
            yield from _literals(given.get(argument))


def _literals(node: ast.expr | None) -> Iterator[str]:
    """A literal, or both of a choice; nothing for what is composed."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from _literals(node.body)
        yield from _literals(node.orelse)


def _is_false(node: ast.expr | None) -> bool:
    return isinstance(node, ast.Constant) and node.value is False


def composed_strings(folder: Path) -> list[str]:
    """Layout texts and reports that are composed without a look-up: nobody can translate them."""
    found = []
    for file in sorted(folder.rglob("*.py")):
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute):
                found += [
                    f"{file.name}:{call.lineno} {ast.unparse(node)}" for node in _shown(call) if _is_composed(node)
                ]
    return found


def _shown(call: ast.Call) -> list[ast.expr]:
    assert isinstance(call.func, ast.Attribute)
    if call.func.attr == "report" and len(call.args) == 2:
        return [call.args[1]]
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    if call.func.attr not in DRAWN or _is_false(given.get("translate")):
        return []
    return [given[name] for name in DRAWN[call.func.attr] if name in given]


def _is_composed(node: ast.expr) -> bool:
    return isinstance(node, (ast.JoinedStr, ast.BinOp))
