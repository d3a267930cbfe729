"""What keeps the contract passes every check, and what breaks it once fails the one check for that."""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path

import contract_toys
import pytest

from baselines.method import Method
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from leaderboard.__main__ import check_command
from leaderboard.contract import check as check_module
from leaderboard.contract import interruptions
from leaderboard.contract.case import Case
from leaderboard.contract.check import check
from leaderboard.contract.trials import BASIC, CHECKS, Result, try_check, try_checks
from leaderboard.runs.train_and_render import only_training

TOYS = Path(contract_toys.__file__).parent
REPOSITORY = Path(__file__).parents[3]
INTERRUPTED = ("Ctrl-C and on", "SIGTERM and on")
QUICK = tuple(name for name in CHECKS if name not in (*INTERRUPTED, "nothing left running"))


@pytest.fixture
def case(tmp_path, monkeypatch):
    """Makes the case of a toy."""
    monkeypatch.setattr(interruptions, "SECONDS", 1.0)

    def of(toy: str) -> Case:
        return Case(f"contract_toys:{toy}", getattr(contract_toys, toy), "demo", 10, tmp_path)

    return of


@pytest.fixture
def trained_here(case, monkeypatch):
    """Trainings run in this process, where the test is not about one of their own; Ctrl-C comes half-way."""

    def train(tried, steps, folder, number=None, moment=0.0):
        method = tried.kind(tried.config(steps), 0)
        step = method.step

        def interrupted(colours):
            if method.state[0] == steps // 2:
                raise KeyboardInterrupt
            step(colours)

        if number is not None:
            method.step = interrupted
        folder.mkdir(parents=True, exist_ok=True)
        try:
            method.fit(only_training(tried.scene), folder)
        except KeyboardInterrupt:
            return 130
        method.save(folder)
        write_json(interruptions._notes(folder) / interruptions.ENDED, {"fit": 0.2, "training": 0.2, "threads": []})
        write_json(interruptions._notes(folder) / interruptions.LEFT, [])
        return 0

    monkeypatch.setattr(interruptions, "SECONDS", 0.1)
    monkeypatch.setattr(interruptions, "_run", train)


def results(case: Case, names=QUICK) -> dict[str, Result]:
    return {name: try_check(case, name, CHECKS[name]).result for name in names}


def test_a_method_that_keeps_the_contract_passes(case):
    outcomes = list(try_checks(case("Good"), CHECKS))
    reasons = {outcome.check: outcome.reason for outcome in outcomes}
    assert {outcome.result for outcome in outcomes} == {Result.PASSED}, reasons
    assert list(reasons) == list(CHECKS)
    assert reasons["configurations"] == "demo, standard"
    assert "with seed 1 others" in reasons["same seed, same result"]
    assert reasons["Ctrl-C and on"].endswith("goes on from checkpoint.json: the same pixels")


@pytest.mark.parametrize(
    ("toy", "broken"),
    [
        ("AnyProfile", "configurations"),
        ("OneSize", "renders any camera"),
        ("Doubles", "renders any camera"),
        ("TooBright", "renders any camera"),
        ("OneArray", "renders any camera"),
        ("Rounds", "saved and loaded"),
        ("InTheWay", "saved and loaded"),
        ("NoTime", "summary"),
        ("Peeks", "held-out views unseen"),
        ("LooksBehindMasks", "masks respected"),
        ("ForgetsWhatIsBad", "bad photographs refused"),
        ("TakesAnything", "other checkpoints refused"),
    ],
)
def test_a_broken_promise_fails_its_check_and_no_other(case, toy, broken):
    found = results(case(toy))
    assert found.pop(broken) == Result.FAILED
    assert set(found.values()) == {Result.PASSED}


@pytest.mark.parametrize(
    ("toy", "check", "result", "reason"),
    [
        ("Unseeded", "same seed, same result", Result.FAILED, ""),
        ("GoesOnElsewhere", "Ctrl-C and on", Result.FAILED, "it ends with other pixels"),
        ("EndsWhenInterrupted", "Ctrl-C and on", Result.FAILED, "returned as if it had ended"),
        ("OnACard", "Ctrl-C and on", Result.NOT_TESTABLE, "ends with other pixels"),
        ("OnACard", "masks respected", Result.NOT_TESTABLE, "by up to"),
    ],
)
@pytest.mark.usefixtures("trained_here")
def test_what_a_check_finds(case, toy, check, result, reason):
    outcome = try_check(case(toy), check, CHECKS[check])
    assert outcome.result == result, outcome.reason
    assert reason in outcome.reason


@pytest.mark.parametrize(("toy", "left"), [("LeavesThread", "thread follower"), ("LeavesProcess", "1 processes")])
def test_what_is_left_running_is_found(case, monkeypatch, toy, left):
    monkeypatch.setattr(interruptions, "LINGER", 0.1)
    monkeypatch.setattr(interruptions, "SECONDS", 0.1)
    outcome = try_check(case(toy), "nothing left running", CHECKS["nothing left running"])
    assert (outcome.result, outcome.reason) == (Result.FAILED, f"left running: {left}")


@pytest.mark.parametrize(
    ("toy", "untold"),
    [("OnACard", {"same seed, same result", "held-out views unseen", "masks respected"}), ("ExactOnACard", set())],
)
def test_on_a_gpu_there_is_no_telling_where_trainings_differ(case, toy, untold):
    expected = {name: Result.NOT_TESTABLE if name in untold else Result.PASSED for name in QUICK}
    assert results(case(toy)) == expected


@pytest.fixture
def only(monkeypatch):
    """Lets `check` make some checks alone, in a process that can import the toys."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, [TOYS, TOYS.parent / "processes", REPOSITORY])))
    return lambda *names: monkeypatch.setattr(check_module, "CHECKS", {name: CHECKS[name] for name in names})


def test_it_is_the_cpu_that_is_checked(only, monkeypatch, caplog):
    only("summary")
    monkeypatch.setattr(check_module, "missing_for_cuda", lambda: None)
    monkeypatch.delenv("HYDROVIEWS_DEVICE", raising=False)
    assert check("contract_toys:TellsDevice", steps=1)[0].reason.endswith(", cpu")
    assert "on the CPU, where the same training gives the same pixels" in caplog.text
    assert "HYDROVIEWS_DEVICE" not in os.environ
    monkeypatch.setenv("HYDROVIEWS_DEVICE", "cuda")
    assert check("contract_toys:TellsDevice", steps=1)[0].reason.endswith(", cuda")


@pytest.mark.usefixtures("trained_here")
def test_without_a_checkpoint_some_checks_cannot_be_made(case, monkeypatch):
    monkeypatch.setattr(interruptions, "ATTEMPTS", 1)
    names = ["fitted twice", "other checkpoints refused", INTERRUPTED[0]]
    assert set(results(case("NoCheckpoint"), names).values()) == {Result.NOT_TESTABLE}
    assert set(results(case("NoCheckpoint"), set(QUICK) - set(names)).values()) == {Result.PASSED}


@pytest.mark.parametrize(
    ("toy", "basic"), [("Unrecordable", "configurations"), ("HoldsAnObject", "configurations"), ("Crashes", "trains")]
)
def test_nothing_is_checked_without_the_basics(only, toy, basic):
    only("found by its name", *BASIC, "masks respected", "summary")
    outcomes = check(f"contract_toys:{toy}", steps=3)
    [failed] = [outcome for outcome in outcomes if outcome.result == Result.FAILED]
    assert failed.check == basic
    later = outcomes[outcomes.index(failed) + 1 :]
    assert {(o.result, o.reason) for o in later} == {(Result.NOT_TESTABLE, f"failed already: {basic}")}
    if toy == "Crashes":
        assert failed.reason == "ArithmeticError: diverged at step 7"
        assert "contract_toys.py" in failed.trace


@pytest.mark.parametrize(
    ("toy", "reason", "trace"),
    [
        ("ExitsWhenRendering", "its process ended before the work was done, with exit status 0", ""),
        ("CrashesWhenRendering", "ended by SIGSEGV", "in render"),
    ],
)
def test_a_check_that_ends_its_process_has_failed_and_the_next_is_made(only, toy, reason, trace):
    only("renders any camera", "summary")
    rendering, summary = check(f"contract_toys:{toy}", steps=1)
    assert (rendering.result, summary.result) == (Result.FAILED, Result.PASSED)
    assert reason in rendering.reason
    assert trace in rendering.trace


def test_a_check_that_never_ends_has_failed(only):
    only("renders any camera")
    (found,) = check("contract_toys:HangsWhenRendering", steps=1, minutes=0.05)
    assert (found.result, found.reason) == (Result.FAILED, "not done after 0.05 minutes (--minutes allows more)")


def test_the_check_itself_can_be_ended(case):
    def ended(_: Case) -> str:
        raise SystemExit(143)

    with pytest.raises(SystemExit):
        try_check(case("Good"), "trains", ended)


def test_it_is_told_in_words_in_json_and_by_the_exit_status(only, tmp_path, caplog):
    only("found by its name", "trains")
    report = tmp_path / "report.json"
    check_command("contract_toys:Good", steps=3, json=report)
    assert "contract_toys:Good: 2 passed, 0 failed, 0 not testable" in caplog.text
    with pytest.raises(SystemExit) as end:
        check_command("contract_toys:Crashes", json=report)
    assert end.value.code == 1
    assert "Traceback" in caplog.text
    told = json.loads(report.read_text())
    assert told["passed"] is False
    checks = [(one["check"], one["result"]) for one in told["checks"]]
    assert checks == [("found by its name", "passed"), ("trains", "failed")]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "nothing"}, "no such method"),
        ({"method": "contract_toys:Good", "profile": "huge"}, "PROFILE=huge"),
        ({"method": "contract_toys:Good", "steps": 0}, "--steps 0"),
        ({"method": "contract_toys:Good", "minutes": float("nan")}, "--minutes nan"),
        ({"method": "module_that_exits:Any"}, "cannot import module_that_exits:Any[\\s\\S]*SystemExit: 0"),
    ],
)
@pytest.mark.usefixtures("only")
def test_what_cannot_be_checked_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        check(**arguments)


@dataclass(frozen=True)
class Nested:
    @dataclass(frozen=True)
    class Inner:
        iterations: int = 500
        rate: float = 0.1

    inner: Inner = field(default_factory=Inner)
    name: str = "x"


def test_settings_are_shortened_wherever_they_count_iterations():
    assert Method.with_max_iterations(Nested(), 20) == Nested(Nested.Inner(20))
    assert Method.with_max_iterations(Nested(), 1000) == Nested()
    assert Method.with_max_iterations(contract_toys.Config(), 7).iterations == 7
    assert Method.with_max_iterations(3, 20) == 3
