import pytest

from core_solver.errors import UserError
from core_solver.evaluation import speed
from core_solver.evaluation.speed import Timing, measure, verdict
from tests.solver.body.synthetic import make_stick_body
from tests.solver.evaluation.fakes import start_here


def test_growth_is_one_where_time_is_linear_in_person_frames():
    first = Timing(300, 3, 5.0, 9.0, 500)
    assert first.milliseconds == pytest.approx(10)
    assert first.line(first).split() == ["300", "3", "5.0", "9.0", "500", "10.00", "1.00"]
    assert Timing(3000, 5, 160.0, 300.0, 900).line(first).split()[-1] == "2.00"


@pytest.mark.parametrize(
    ("seconds", "peak_mb", "word"), [(20, 2000, "met"), (20.1, 100, "MISSED"), (1, 2001, "MISSED")]
)
def test_the_verdict_is_about_both_bars(seconds, peak_mb, word):
    assert verdict(Timing(300, 3, seconds, 99.0, peak_mb)).endswith(word)


def test_a_size_is_solved_and_timed(monkeypatch):
    monkeypatch.setattr(speed.Job, "start", start_here)
    (timing,) = measure([(6, 2)], "baseline", make_stick_body())
    assert (timing.frames, timing.people) == (6, 2)
    assert 0 < timing.seconds < 60
    assert timing.peak_mb > 50


def test_a_failed_solve_is_an_error_with_its_reason(monkeypatch):
    def fail(job):
        raise speed.SolveFailedError("out of luck")

    monkeypatch.setattr(speed, "run_jobs", lambda jobs, *_: jobs)
    monkeypatch.setattr(speed.Job, "result", fail)
    with pytest.raises(UserError, match=r"6 frames with 1 people.*out of luck"):
        list(measure([(6, 1)], "baseline", make_stick_body()))


def test_bad_arguments_are_refused(capsys):
    assert speed.main(["--preset", "slowest"]) == 2
    assert capsys.readouterr().err.startswith("error: there is no preset called slowest")
