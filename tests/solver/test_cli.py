import io
import json
import logging
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import core_solver
from core_solver import cli
from core_solver.console import BarProgress, JsonProgress
from core_solver.errors import VideoError
from core_solver.optimise.presets import PRESETS
from core_solver.pipeline import SolveOptions
from core_solver.take import FORMAT, VERSION, write_take
from tests.solver.preview.takes import CAMERA_HEIGHT, make_take, write_video


@pytest.fixture
def take_path(tmp_path):
    path = tmp_path / "clip.npz"
    write_take(path, make_take())
    return path


@pytest.fixture
def video_path(tmp_path):
    return write_video(tmp_path / "clip.avi", make_take().meta.camera, 12)


def run(capsys, *arguments) -> tuple[int, str, str]:
    code = cli.main([str(a) for a in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def assert_refused(result, *words) -> None:
    code, out, err = result
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    for word in words:
        assert word in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("COMMAND",)),
        (("dance",), ("dance",)),
        (("solve",), ("VIDEO",)),
        (("solve", "{video}"), ("--output",)),
        (("solve", "missing.mp4", "-o", "{dir}/t.npz"), ("missing.mp4",)),
        (("solve", "{dir}", "-o", "{dir}/t.npz"), ("directory",)),
        (("solve", "{video}", "-o", "{dir}/t.txt"), ("t.txt", ".npz")),
        (("solve", "{video}", "-o", "{dir}/t.NPZ"), ("t.NPZ", ".npz")),
        (("solve", "{video}", "-o", "{dir}"), (".npz",)),
        (("solve", "{video}", "-o", "{video}/t.npz"), ("-o",)),
        (("solve", "{video}", "-o", "t.npz", "--camera", "a", "--fov", "50"), ("--camera", "--fov")),
        (("solve", "{video}", "-o", "t.npz", "--fov", "4"), ("--fov", "5 to 150")),
        (("solve", "{video}", "-o", "t.npz", "--fov", "wide"), ("wide",)),
        (("solve", "{video}", "-o", "t.npz", "--fov", "nan"), ("nan",)),
        (("solve", "{video}", "-o", "t.npz", "--every", "0"), ("--every", "at least 1")),
        (("solve", "{video}", "-o", "t.npz", "--every", "1.5"), ("--every",)),
        (("solve", "{video}", "-o", "t.npz", "--people", "-1"), ("--people",)),
        (("solve", "{video}", "-o", "t.npz", "--points", "0"), ("--points", "at least 1")),
        (("solve", "{video}", "-o", "t.npz", "--start", "-1"), ("--start",)),
        (("solve", "{video}", "-o", "t.npz", "--start", "inf"), ("--start",)),
        (("solve", "{video}", "-o", "t.npz", "--start", "3", "--end", "2"), ("--end 2", "--start 3")),
        (("solve", "{video}", "-o", "t.npz", "--device", "tpu"), ("tpu",)),
        (("solve", "{video}", "-o", "t.npz", "--preset", "slow"), ("slow", "fast", "exact", "paper")),
        (("solve", "{video}", "-o", "t.npz", "--depth", "no.onnx"), ("no.onnx", "--depth")),
        (("solve", "{video}", "-o", "t.npz", "--body", "no.pkl"), ("no.pkl", "--body")),
        (("preview", "{take}", "missing.mp4", "-o", "{dir}"), ("missing.mp4",)),
        (("preview", "{dir}/no.npz", "{video}", "-o", "{dir}"), ("no.npz",)),
        (("inspect", "{dir}/no.npz"), ("no.npz",)),
        (("inspect", "{video}"), ("clip.avi",)),
    ],
)
def test_bad_input_gets_one_line_and_exit_code_2(capsys, tmp_path, take_path, video_path, arguments, words):
    places = {"dir": tmp_path, "take": take_path, "video": video_path}
    before = sorted(p.name for p in tmp_path.iterdir())
    assert_refused(run(capsys, *(a.format(**places) for a in arguments)), *words)
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_version_and_help(capsys):
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as stop:
            cli.main([flag])
        assert stop.value.code == 0
    assert core_solver.__version__ in capsys.readouterr().out


def test_help_explains_each_preset_that_there_is_in_one_line(capsys):
    with pytest.raises(SystemExit):
        cli.main(["solve", "--help"])
    _, _, listed = capsys.readouterr().out.partition("presets:\n")
    explained = dict(line.split(maxsplit=1) for line in listed.splitlines())
    assert list(explained) == list(PRESETS)
    assert [name for name, meaning in explained.items() if "default" in meaning] == [SolveOptions.preset]


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_solve_passes_each_preset(monkeypatch, tmp_path, video_path, preset):
    pipeline = FakePipeline(monkeypatch, make_take())
    assert cli.main(["solve", str(video_path), "-o", str(tmp_path / "t.npz"), "--preset", preset]) == 0
    assert pipeline.options.preset == preset


def test_inspect_for_people(capsys, take_path):
    code, out, err = run(capsys, "inspect", take_path)
    assert (code, err) == (0, "")
    for words in ("clip.avi", "12 frames", "Person 1", "1.70 m", "6 of 12", "ground-plane prior", "moved by 2 pixels"):
        assert words in out


def test_inspect_json_says_what_the_take_holds(capsys, take_path):
    take = make_take()
    code, out, _ = run(capsys, "inspect", take_path, "--json")
    facts = json.loads(out)
    assert code == 0
    assert (facts["format"], facts["format_version"]) == (FORMAT, VERSION)
    assert facts["file_size_bytes"] == take_path.stat().st_size
    assert (facts["frame_count"], facts["frames_per_second"]) == (12, 25.0)
    assert facts["duration_s"] == pytest.approx(11 / 25)
    assert facts["camera"]["fx"] == take.meta.camera.fx
    assert facts["camera"]["height_above_ground_m"] == pytest.approx(CAMERA_HEIGHT)
    assert facts["depth_source"] == "ground-plane prior"
    assert facts["warnings"] == ["the camera moved by 2 pixels"]
    assert [p["id"] for p in facts["people"]] == [1, 2]
    first, second = facts["people"]
    assert first["height_m"] == pytest.approx(1.70, abs=0.01)
    assert (first["frames_seen"], first["first_frame"], first["last_frame"]) == (12, 0, 11)
    assert (second["frames_seen"], second["first_frame"], second["last_frame"]) == (6, 0, 5)
    # Walkers start at (x, z) and glide: truth from the scene's construction.
    assert first["position_min"][0] == pytest.approx(-0.6, abs=2e-3)
    assert first["position_max"][0] == pytest.approx(-0.6 + 0.5 * 11 / 25, abs=2e-3)
    assert second["position_max"][2] == pytest.approx(5.0 + 0.4 * 5 / 25, abs=2e-3)
    assert facts["position_max"][2] == second["position_max"][2]


def test_inspect_json_of_nobody_and_of_somebody_never_seen(capsys, tmp_path):
    nobody, unseen = tmp_path / "nobody.npz", tmp_path / "unseen.npz"
    write_take(nobody, make_take(people=()))
    write_take(unseen, make_take(people=(replace(make_take().people[0], valid=np.zeros(12, bool)),)))
    facts = json.loads(run(capsys, "inspect", nobody, "--json")[1])
    assert (facts["people"], facts["position_min"]) == ([], None)
    facts = json.loads(run(capsys, "inspect", unseen, "--json")[1])
    assert facts["people"][0]["first_frame"] is None
    for path in (nobody, unseen):
        assert run(capsys, "inspect", path)[0] == 0


def test_preview_command(capsys, tmp_path, take_path, video_path):
    code, out, _ = run(capsys, "preview", take_path, video_path, "-o", tmp_path / "look")
    assert code == 0
    assert out.splitlines() == [str(tmp_path / "look" / name) for name in ("overlay.mp4", "overview.png")]
    assert all((tmp_path / "look" / name).stat().st_size > 1000 for name in ("overlay.mp4", "overview.png"))


class FakePipeline:
    """Stands in for the solver: the command's own work is what is tested."""

    def __init__(self, monkeypatch, outcome):
        from core_solver import pipeline

        self.options = None
        self.outcome = outcome
        monkeypatch.setattr(pipeline, "solve_video", self)

    def __call__(self, options, progress):
        self.options = options
        with progress.stage("people", 4) as advance:
            advance(4)
        if isinstance(self.outcome, BaseException):
            raise self.outcome
        write_take(options.output, self.outcome)
        return self.outcome


def test_solve_passes_every_option_and_sums_up(capsys, monkeypatch, tmp_path, video_path):
    pipeline = FakePipeline(monkeypatch, make_take())
    depth, output = tmp_path / "depth.onnx", tmp_path / "my take.npz"
    depth.write_text("")
    code, out, err = run(
        capsys, "solve", video_path, "-o", output, "--fov", "60", "--start", "1", "--end", "2.5", "--every", "3",
        "--people", "2", "--depth", depth, "--models-dir", tmp_path, "--device", "cpu", "--resume", "--body", depth,
        "--preset", "fast", "--points", "5000",
    )  # fmt: skip
    assert code == 0
    got = pipeline.options
    assert got is not None
    assert (got.video, got.output, got.camera, got.fov_degrees) == (video_path, output, None, 60.0)
    assert (got.start_s, got.end_s, got.every, got.people) == (1.0, 2.5, 3, 2)
    assert (got.depth, got.models_dir, got.body) == (depth, tmp_path, depth)
    assert (got.device, got.preset, got.resume, got.points) == ("cpu", "fast", True, 5000)
    for words in ("Person 2", "6 of 12", "test lens", "ground-plane prior", "moved by 2 pixels", "people", "total"):
        assert words in out
    assert f"preview '{output}' {video_path}" in out
    assert "people: 100 %" in err


def test_solve_defaults(capsys, monkeypatch, tmp_path, video_path):
    pipeline = FakePipeline(monkeypatch, make_take())
    assert run(capsys, "solve", video_path, "-o", tmp_path / "t.npz", "--camera", "lab.qca.txt:cam01")[0] == 0
    got = pipeline.options
    assert got is not None
    assert (got.camera, got.fov_degrees, got.start_s, got.end_s, got.every) == (
        "lab.qca.txt:cam01",
        None,
        None,
        None,
        1,
    )
    assert (got.people, got.depth, got.device, got.resume, got.seed) == (None, None, "auto", False, 0)
    assert got.points == 200_000


@pytest.mark.parametrize(
    ("outcome", "code", "words"),
    [
        (VideoError("nobody\nis in it"), 2, "error: nobody is in it"),
        (KeyboardInterrupt(), 130, "--resume"),
        (RuntimeError("a\nb"), 1, "error: unexpected RuntimeError: a b (run with --debug"),
        (OSError(28, "No space left on device"), 1, "No space left"),
        (MemoryError(), 1, "MemoryError"),
    ],
)
def test_failures_end_in_one_line(capsys, monkeypatch, tmp_path, video_path, outcome, code, words):
    FakePipeline(monkeypatch, outcome)
    found, _, err = run(capsys, "solve", video_path, "-o", tmp_path / "t.npz")
    assert found == code
    assert words in err.splitlines()[-1]
    assert "Traceback" not in err
    assert not (tmp_path / "t.npz").exists()


@pytest.mark.parametrize(
    ("command", "resumes"),
    [
        (("solve", "{video}", "-o", "t.npz"), True),
        (("preview", "{take}", "{video}", "-o", "p"), False),
        (("inspect", "{take}"), False),
        (("models", "list"), False),
    ],
)
def test_ctrl_c_speaks_of_resuming_only_where_that_helps(capsys, monkeypatch, take_path, video_path, command, resumes):
    def stop(*_args, **_kwargs):
        raise KeyboardInterrupt

    for place in (
        "core_solver.pipeline.solve_video", "core_solver.preview.write_preview", "core_solver.take.read_take",
        "core_solver.perception.models_cli.ModelStore",
    ):  # fmt: skip
        monkeypatch.setattr(place, stop)
    code, _, err = run(capsys, *(a.format(take=take_path, video=video_path) for a in command))
    assert code == 130
    assert err.startswith("stopped: ")
    assert ("--resume" in err) == resumes


def test_warnings_read_like_other_lines(take_path):
    script = (
        "import logging, sys; from core_solver import cli, inspection\n"
        "facts = inspection.take_facts\n"
        "def warn(*a): logging.getLogger('core_solver.x').warning('it is late'); return facts(*a)\n"
        "inspection.take_facts = warn\n"
        "sys.exit(cli.main(sys.argv[1:]))"
    )
    for flags, line in (([], "warning: it is late\n"), (["-v"], "warning core_solver.x: it is late\n")):
        command = [sys.executable, "-c", script, "inspect", str(take_path), *flags]
        assert subprocess.run(command, capture_output=True, text=True, check=True).stderr == line


@pytest.mark.parametrize("by_environment", [False, True])
def test_debug_shows_the_traceback(capsys, monkeypatch, tmp_path, video_path, by_environment):
    FakePipeline(monkeypatch, RuntimeError("deep down"))
    if by_environment:
        monkeypatch.setenv(cli.DEBUG_VARIABLE, "1")
    flags = [] if by_environment else ["--debug"]
    code, _, err = run(capsys, "solve", video_path, "-o", tmp_path / "t.npz", *flags)
    assert code == 1
    assert "Traceback" in err


@pytest.mark.parametrize("arguments", [("-v", "inspect"), ("inspect", "-v")])
def test_verbose_before_and_after_the_command(monkeypatch, take_path, arguments):
    levels = []
    monkeypatch.setattr(logging, "basicConfig", lambda **settings: levels.append(settings["level"]))
    assert cli.main([*arguments, str(take_path)]) == 0
    assert levels == [logging.INFO]


def test_a_reader_that_goes_away_is_no_disaster(take_path):
    command = [sys.executable, "-m", "core_solver.cli", "inspect", str(take_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    process.wait()


def test_progress_lines_for_programs():
    stream = io.StringIO()
    progress = BarProgress(stream)
    with progress.stage("people", 1000) as advance:
        for _ in range(1000):
            advance(1)
    progress.note("a remark")
    lines = stream.getvalue().splitlines()
    assert lines[0] == "people: started"
    assert [line.split(" %")[0] for line in lines[1:-1]] == [f"people: {p}" for p in range(10, 101, 10)]
    assert lines[-1] == "a remark"


def test_progress_as_json_tells_the_beginning_the_end_and_little_between(monkeypatch):
    now = iter(np.arange(0, 100, 0.01))
    monkeypatch.setattr("core_solver.console.time.monotonic", lambda: next(now))
    stream = io.StringIO()
    progress = JsonProgress(stream)
    with progress.stage("people", 1000) as advance:
        for _ in range(1000):
            advance(1)
    progress.note("a remark\nof two lines")
    events = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert events[0] == {"stage": "people", "done": 0, "total": 1000}
    assert events[-2] == {"stage": "people", "done": 1000, "total": 1000}
    assert events[-1] == {"note": "a remark\nof two lines"}
    done = [event["done"] for event in events[:-1]]
    assert done == sorted(done)
    assert 20 < len(done) < 100
    assert list(progress.seconds) == ["people"]


def test_progress_bar_on_a_terminal_shows_the_stage_and_what_is_left():
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    stream = Terminal()
    progress = BarProgress(stream)
    with progress.stage("people", 10) as advance:
        advance(10)
    progress.note("a remark")
    text = stream.getvalue()
    assert "people" in text
    assert "10/10" in text
    assert "left" in text
    assert "a remark" in text


def test_seconds_per_stage_add_up(monkeypatch):
    now = iter([0.0, 2.0, 10.0, 13.0, 20.0, 21.0])
    monkeypatch.setattr("core_solver.console.time.perf_counter", lambda: next(now))

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    progress = BarProgress(Terminal())
    for name in ("people", "solve", "people"):
        with progress.stage(name, 1):
            pass
    assert progress.seconds == {"people": 3.0, "solve": 3.0}
    assert [line.split() for line in progress.summary().splitlines()] == [
        ["people", "3.0", "s"], ["solve", "3.0", "s"], ["total", "6.0", "s"],
    ]  # fmt: skip
