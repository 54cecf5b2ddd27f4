"""What is done in the window: every generator yields the seconds after which it goes on. Runs inside Blender."""

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import hands

MODULE = "bl_ext.user_default.scene_aware_mocap"


def sections() -> Iterator[float]:
    """The tab opens and every section of it draws."""
    yield from hands.open_tab()
    for name in hands.SECTIONS:
        panel = getattr(bpy.types, f"VIEW3D_PT_scene_aware_mocap_{name}")
        assert panel.bl_category == hands.TAB
    yield from hands.shoot("sections")
    colours = {tuple(pixel) for pixel in hands.sidebar_picture().reshape(-1, 3)[::7]}
    assert len(colours) > 20, "the sidebar is empty"


def sample() -> Iterator[float]:
    """The sample take comes in and plays before its footage."""
    yield from hands.open_tab()
    with hands.in_view():
        assert bpy.ops.scene_aware_mocap.load_sample_take("EXEC_DEFAULT", True) == {"FINISHED"}
    assert sum(o.type == "ARMATURE" for o in bpy.data.objects) == 3
    yield 0.5
    bpy.context.scene.frame_set(75)
    with hands.in_view():
        bpy.ops.view3d.view_camera()
    yield from hands.shoot("sample")
    with hands.in_view():
        bpy.ops.screen.animation_play()
    before = bpy.context.scene.frame_current
    yield 2.0
    assert bpy.context.scene.frame_current != before
    with hands.in_view():
        bpy.ops.screen.animation_cancel()
        bpy.ops.ed.undo()
    yield 0.5
    assert not any(o.type == "ARMATURE" for o in bpy.data.objects)


def tutorial() -> Iterator[float]:
    """docs/first_steps.md, step by step, with what its pictures show."""
    yield from hands.open_tab()
    with hands.in_view():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        bpy.ops.scene_aware_mocap.load_sample_take("INVOKE_DEFAULT", True)
    yield from hands.open_section("import")
    bpy.context.scene.frame_set(75)
    with hands.in_view():
        bpy.ops.view3d.view_camera()
    yield from hands.shoot("first_steps_take")
    with hands.in_view():
        bpy.ops.scene_aware_mocap.load_sample_rig("INVOKE_DEFAULT", True)
    rig = bpy.data.objects["Sample Rig"]
    bpy.context.scene.mocap_retarget.rig = rig
    yield from hands.open_section("retarget")
    with hands.in_view():
        _press("retarget", bpy.context.scene.mocap_retarget, rig=rig.name)
    rigs = [f"Sample Rig {name}" for name in ("Ada", "Ben", "Cleo")]
    assert sorted(obj.name for obj in bpy.context.selected_objects) == rigs
    for name in ("Ada", "Ben", "Cleo"):
        bpy.context.view_layer.layer_collection.children["sample_take"].children[name].hide_viewport = True
    yield from hands.shoot("first_steps_retarget")
    yield from hands.open_section("export")
    with hands.in_view():
        bpy.ops.wm.save_as_mainfile(filepath=str(Path(os.environ["FOLDER"]) / "handshake.blend"))
        settings = bpy.context.scene.mocap_export
        settings.engine, settings.folder, settings.file_name = "generic", "//", "handshake"
        _press("export", settings, directory="//", file_name="handshake")
    assert settings.checks, "nothing was read back"
    assert all(check.passed for check in settings.checks), [check.text for check in settings.checks]
    assert hands.view3d().spaces.active.region_3d.view_perspective == "CAMERA", "the export has changed the view"
    yield from hands.shoot("first_steps_export")


def _press(operator: str, settings: bpy.types.PropertyGroup, **more: str) -> None:
    """Press a section's button: its operator with the section's choices."""
    called = getattr(bpy.ops.scene_aware_mocap, operator)
    known = set(called.get_rna_type().properties.keys()) - {"name"}
    values = {name: getattr(settings, name) for name in known if name in settings.bl_rna.properties}
    chosen = {name: value for name, value in values.items() if isinstance(value, (str, int, float, bool))}
    assert called("EXEC_DEFAULT", True, **(chosen | more)) == {"FINISHED"}


def clean() -> Iterator[float]:
    """Cleaning works part by part: Esc stops it with nothing changed; otherwise there is a new action and one undo."""
    yield from hands.open_tab()
    with hands.in_view():
        bpy.ops.scene_aware_mocap.load_sample_take("INVOKE_DEFAULT", True)
    ada = bpy.data.objects["Ada"]
    before = ada.animation_data.action
    with hands.in_view():
        assert bpy.ops.scene_aware_mocap.lock_feet("INVOKE_DEFAULT", True) == {"RUNNING_MODAL"}
    hands.press("ESC")
    yield 1.5
    assert ada.animation_data.action == before
    with hands.in_view():
        bpy.ops.scene_aware_mocap.lock_feet("INVOKE_DEFAULT", True)
    end = time.monotonic() + 60
    while ada.animation_data.action == before:
        assert time.monotonic() < end
        yield 0.2
    yield from hands.open_section("clean")
    yield from hands.shoot("clean")


def german() -> Iterator[float]:
    """Sections, buttons and reports speak German when Blender does."""
    view = bpy.context.preferences.view
    view.language = "de_DE"
    view.use_translate_interface = view.use_translate_tooltips = view.use_translate_reports = True
    translations = bpy.app.translations
    assert translations.pgettext_iface("Keep Footprints") == "Fußabdrücke behalten"
    assert translations.pgettext_iface("Load Sample Take", "Operator") == "Beispiel-Take laden"
    assert translations.pgettext_rpt("Solver {} found") == "Solver {} gefunden"
    yield from hands.open_tab()
    with hands.in_view():
        bpy.ops.scene_aware_mocap.load_sample_take("INVOKE_DEFAULT", True)
    yield from hands.open_section("retarget")
    yield from hands.shoot("german")


def solve() -> Iterator[float]:
    """Blender stays responsive while the solver runs; the take comes in at the end."""
    preferences = bpy.context.preferences.addons[MODULE].preferences
    preferences.solver_python = os.environ["SOLVER_PYTHON"]
    watch = sys.modules[f"{MODULE}.solving.watch"]
    yield from hands.open_tab()
    yield from hands.open_section("solve")
    with hands.in_view():
        assert bpy.ops.scene_aware_mocap.solve_video(video=os.environ["VIDEO"]) == {"FINISHED"}
    assert watch.current() is not None
    waits, last, fractions, shown = [], time.monotonic(), set(), False
    end = last + 60
    while watch.current() is not None:
        assert time.monotonic() < end, watch.current().process.lines
        yield 0.05
        now = time.monotonic()
        waits.append(now - last)
        last = now
        running = watch.current()
        if running is not None:
            fractions.add(running.process.stage.fraction)
            if running.process.stage.fraction > 0.3 and not shown:
                shown = True
                yield from hands.shoot("solving")
                last = time.monotonic()
    waits.sort()
    sys.stdout.write(f"longest wait {waits[-1]:.3f} s, {len(fractions)} fractions\n")
    assert len(fractions) > 5
    assert waits[len(waits) // 2] < 0.3  # 0.05 asked; the display is drawn by the processor
    assert waits[-1] < 5  # the import at the end is one of them
    assert watch.last_outcome().good, watch.last_outcome().message
    assert sum(o.type == "ARMATURE" for o in bpy.data.objects) == 3
    assert "all is well" in bpy.data.texts["Solve Log"].as_string()
    yield from hands.shoot("solved")


def cancel() -> Iterator[float]:
    """Cancel stops the solver; the window says so and nothing comes in."""
    preferences = bpy.context.preferences.addons[MODULE].preferences
    preferences.solver_python = os.environ["SOLVER_PYTHON"]
    watch = sys.modules[f"{MODULE}.solving.watch"]
    before = len(bpy.data.objects)
    with hands.in_view():
        bpy.ops.scene_aware_mocap.solve_video(video=os.environ["VIDEO"])
    yield 1.0
    with hands.in_view():
        assert bpy.ops.scene_aware_mocap.cancel_solve() == {"FINISHED"}
    end = time.monotonic() + 20
    while watch.current() is not None:
        assert time.monotonic() < end
        yield 0.1
    assert "cancelled" in watch.last_outcome().message
    assert len(bpy.data.objects) == before


def quit_while_solving() -> Iterator[float]:
    """Blender takes the solver along when it is closed."""
    preferences = bpy.context.preferences.addons[MODULE].preferences
    preferences.solver_python = os.environ["SOLVER_PYTHON"]
    with hands.in_view():
        bpy.ops.scene_aware_mocap.solve_video(video=os.environ["VIDEO"])
    yield 0.5


if __name__ == "__main__":
    hands.run(globals()[sys.argv[-1]])
