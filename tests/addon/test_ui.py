"""What the user sees: the menu entry and the sidebar panel, drawn on a layout that writes down what it is given."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from core_solver.take import write_take

from .blender_truth import armature_of
from .take_factory import TakeSpec, make_take


class Layout:
    def __init__(self) -> None:
        self.drawn: list[str] = []

    def operator(self, name: str, *, text: str, **_: str) -> None:
        self.drawn.append(f"{name}: {text}")

    def label(self, *, text: str, **_: str) -> None:
        self.drawn.append(text)

    def box(self) -> "Layout":
        return self


def test_file_import_menu_has_the_entry(bpy: Any) -> None:
    menu = SimpleNamespace(layout=Layout())
    entries = [
        draw for draw in bpy.types.TOPBAR_MT_file_import._dyn_ui_initialize() if "scene_aware" in draw.__module__
    ]
    assert len(entries) == 1
    entries[0](menu, bpy.context)
    assert menu.layout.drawn == ["import_scene.scene_aware_mocap: Scene-Aware Mocap (.npz)"]


def test_panel_tells_about_the_active_person(bpy: Any, addon: Any, tmp_path: Path) -> None:
    panel = addon("panels.import_section").ImportPanel
    take = make_take(TakeSpec(people=1, points=8))
    empty = SimpleNamespace(layout=Layout())
    panel.draw(empty, SimpleNamespace(object=None))
    assert len(empty.layout.drawn) == 1
    write_take(tmp_path / "match.npz", take)
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"))
    shown = SimpleNamespace(layout=Layout())
    panel.draw(shown, SimpleNamespace(object=armature_of(bpy, take.people[0])))
    assert f"Height {take.people[0].height_m:.2f} m" in shown.layout.drawn
    assert "Body boxes" in shown.layout.drawn


def test_import_can_be_undone_from_the_menu(bpy: Any) -> None:
    operator = bpy.ops.import_scene.scene_aware_mocap
    assert "UNDO" in operator.bl_options
    assert operator.get_rna_type().name == "Import Scene-Aware Mocap (.npz)"
