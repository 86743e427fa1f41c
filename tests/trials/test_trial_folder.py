"""A trial goes from requirement to verdict in one folder; what is out of order is refused."""

import json
import shutil

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.trials import read_register
from flgpr_trials.commands.plan import check_register, plan_lane, survey_plan
from flgpr_trials.commands.seal import seal
from flgpr_trials.commands.trial import trial_intake, trial_new, trial_verdict

PHRASE = "correct horse battery"


def nobody():
    raise AssertionError("nobody is asked for a passphrase")


def short_lane(home):
    """Write a lane beside a trial, whose map is drawn in one strip."""
    lane = home.with_name("lane.toml")
    lane.write_text("x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 30.0\n")
    return lane


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    """A trial whose truth is sealed, and two lists of vendors beside it."""
    pytest.importorskip("cryptography")
    home = tmp_path_factory.mktemp("trials") / "t"
    trial_new(home, pd_claim=0.5, lane=short_lane(home))
    (home / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,5\nplastic,0.1,4\n")
    plan, _ = plan_lane(home / "lanes.toml", home / "sorts.csv", home / "plan.csv", 3)
    sheet = pd.read_csv(home / "plan-sheet.csv", dtype=str).assign(emplaced="yes")
    sheet.to_csv(home / "filled.csv", index=False)
    survey_plan(home / "plan.csv", home / "filled.csv", home / "truth.csv")
    seal(home / "truth.csv", home / "lanes.toml", home / "truth.sealed", passphrase=PHRASE)
    near = plan[["x", "y"]].assign(confidence=range(len(plan)))
    near.to_csv(home.parent / "acme.csv", index=False)
    near[3:].to_csv(home.parent / "globex.csv", index=False)
    return home


@pytest.fixture
def trial(sealed, tmp_path):
    shutil.copytree(sealed.parent, tmp_path / "trials")
    return tmp_path / "trials" / "t"


def take_in(trial, vendor="ACME", name="acme.csv", signed="A. Director", **how):
    return trial_intake(trial, vendor, trial.parent / name, signed, **how)


def test_a_folder_is_begun_once_and_its_requirement_is_registered(tmp_path):
    home = tmp_path / "t"
    told = CliRunner().invoke(app, ["trial", "new", str(home), "--pd", "0.8"])
    assert "to show: Pd >= 0.8 with 95 % confidence at 0.05 false alarms per m²" in told.stdout
    assert pd.read_csv(home / "sorts.csv")["count"].sum() == 14  # 0.8^14 < 0.05
    assert read_register(home / "register.jsonl")[0]["requirement"]["pd"] == 0.8
    kept = (home / "register.jsonl").read_bytes()
    trial_new(home, pd_claim=0.8)
    assert (home / "register.jsonl").read_bytes() == kept
    with pytest.raises(FileExistsError, match="choose another folder"):
        trial_new(home)
    with pytest.raises(ValueError, match=r"requirement.confidence: .*got 0.3"):
        trial_new(tmp_path / "other", confidence=0.3)
    with pytest.raises(ValueError, match="pd must be finite, got nan"):
        trial_new(tmp_path / "other", pd_claim=float("nan"))
    assert not (tmp_path / "other").exists()
    text = (home / "trial.toml").read_text()
    (home / "trial.toml").write_text(text.replace("0.8", "0.7"))
    with pytest.raises(ValueError, match="must be those registered in line 1"):
        trial_verdict(home, passphrase=nobody)


def test_plan_and_seal_find_the_register_and_keep_the_requirement(tmp_path):
    home = tmp_path / "t"
    trial_new(home, far=0.02, halo=0.5, lane=short_lane(home))
    (home / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,3\n")
    paths = (home / "lanes.toml", home / "sorts.csv", home / "plan.csv")
    with pytest.raises(ValueError, match=r"halo must be 0.5 as the trial of .* asks for, got 1"):
        plan_lane(*paths, 1, far=0.02)
    with pytest.raises(ValueError, match=r"far must be 0.02 as the trial of .* asks for, got 0.05"):
        plan_lane(*paths, 1, halo=0.5)
    assert not (home / "plan.csv").exists()
    plan_lane(*paths, 1, halo=0.5, far=0.02)
    assert [line["event"] for line in read_register(home / "register.jsonl")] == ["trial", "plan"]


def test_the_commands_of_the_readme_state_numbers_in_full(tmp_path):
    home = tmp_path / "t"
    trial_new(home, far=0.123456789, halo=1.2345678, lane=short_lane(home))
    (home / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,3\n")
    command = (home / "README.md").read_text().split("`flgpr plan lane ")[1].split("`")[0]
    is_file = (".toml", ".csv")
    words = [str(home / word) if word.endswith(is_file) else word for word in command.split()]
    told = CliRunner().invoke(app, ["plan", "lane", *words])
    assert told.exit_code == 0, told.output


def test_too_few_mines_are_told_before_lists_come(tmp_path):
    home = tmp_path / "t"
    trial_new(home, pd_claim=0.5, lane=short_lane(home))
    (home / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,5\n")

    def told(*words):
        done = CliRunner().invoke(app, ["plan", *map(str, words)])
        assert done.exit_code == 0, done.output
        return done.stdout

    plan = home / "plan.csv"
    whole = told("lane", home / "lanes.toml", home / "sorts.csv", "-o", plan, "--far", 0.05)
    assert "too few" not in whole
    sheet = pd.read_csv(home / "plan-sheet.csv", dtype=str).assign(emplaced="yes")
    sheet.loc[3, "emplaced"] = "no"
    sheet.to_csv(home / "filled.csv", index=False)
    left = told("survey", plan, home / "filled.csv", "-o", home / "truth.csv")
    assert left.endswith(
        "4 mines are too few: Pd >= 0.5 with 95 % confidence takes 5 without a miss, "
        "so that no detector can show it\n"
    )


def test_from_intake_to_verdict(trial):
    shown = take_in(trial, signed=None)
    assert shown.line is None
    assert "Not signed" in shown.page.read_text()
    assert (
        shown.page.read_text()
        .split("<h1>")[1]
        .startswith("All 9 rows of ACME&#39;s list are used.")
    )
    with pytest.raises(
        ValueError, match=r"must be signed before the truth is opened, got .*acme.csv"
    ):
        trial_verdict(trial, passphrase=nobody)
    line = take_in(trial).line
    assert (line["vendor"], line["signed"], line["rows"]) == ("ACME", "A. Director", [9, 9])
    assert take_in(trial).line == line
    assert "Signed by A. Director" in shown.page.read_text()
    take_in(trial, "Globex", "globex.csv")
    verdict = trial_verdict(trial, passphrase=PHRASE)
    assert verdict.in_words() == (
        "At the registered 0.05 per m²: ACME 9 of 9, Globex 6 of 9, not told apart (p = 0.25); "
        "ACME alone shows Pd >= 0.5 with 95 % confidence."
    )
    told = json.loads((trial / "verdict.json").read_text())
    assert told["verdict"] == verdict.in_words()
    assert [told["notes"][name]["looks"] for name in ("ACME", "Globex")] == [1, 2]
    assert "threshold" not in told["points"][0]
    _, heads = check_register(trial / "register.jsonl", trial / "verdict.json")
    assert len(heads) == 1

    assert trial_verdict(trial, passphrase=nobody) is None, "it is there already"
    with pytest.raises(ValueError, match="a list must be taken in before the truth is opened"):
        take_in(trial, "Initech")
    assert trial_verdict(trial, True, passphrase=PHRASE) is not None
    looks = [line for line in read_register(trial / "register.jsonl") if "look" in line]
    assert len(looks) == 4


def test_a_list_that_takes_the_place_of_a_signed_one_says_so_and_may_go_back(trial):
    assert take_in(trial).replaced is None
    words = ["trial", "intake", str(trial), "ACME", str(trial.parent / "globex.csv")]
    told = CliRunner().invoke(app, words).stdout
    assert "it takes the place of the list that A. Director signed, line 5\nnot signed" in told
    second = take_in(trial, name="globex.csv")
    assert (second.line["number"], second.replaced["number"]) == (6, 5)
    back = take_in(trial)
    assert (back.line["number"], back.replaced["number"]) == (7, 6), "the last line counts"
    assert take_in(trial, signed=None).line == back.line, "it is signed already"
    assert trial_verdict(trial, passphrase=PHRASE).points["n_detected"].tolist() == [9]
    told = CliRunner().invoke(app, ["trial", "verdict", str(trial)]).stdout
    assert told.startswith("At the registered 0.05 per m²: ACME 9 of 9; "), (
        "a verdict that is there"
    )


@pytest.mark.parametrize("name", ["acme.csv", "acme.used.csv"])
def test_a_list_that_was_changed_after_it_was_signed_is_refused(trial, name):
    take_in(trial)
    with (trial / "lists" / name).open("a") as file:
        file.write("0.5,1.0,99\n")
    with pytest.raises(ValueError, match=r"must be as it was signed on .* which was changed"):
        trial_verdict(trial, passphrase=nobody)
    take_in(trial)
    assert trial_verdict(trial, passphrase=PHRASE).points["n_detected"].tolist() == [9]


def test_what_is_doubtful_is_not_signed(trial):
    alarms = pd.read_csv(trial.parent / "acme.csv")
    alarms.assign(x=alarms["x"] / 0.3048, y=alarms["y"] / 0.3048).to_csv(
        trial.parent / "feet.csv", index=False
    )
    with pytest.raises(
        ValueError, match=r"must be in metres of the lane to be signed: .*--unit ft"
    ):
        take_in(trial, name="feet.csv")
    assert take_in(trial, name="feet.csv", signed=None).read.unit == "ft"
    assert len(take_in(trial, name="feet.csv", unit="ft").read.used) == 9
    (trial.parent / "none.csv").write_text("x,y,confidence\n0,a,1\n")
    with pytest.raises(ValueError, match=r"must have a row that is used.*1 is unreadable"):
        take_in(trial, name="none.csv")
    with pytest.raises(ValueError, match="signed must be a name of 1 to 120 characters"):
        take_in(trial, signed=" ")
    with pytest.raises(ValueError, match="vendor must differ from 'ACME' in letters or digits"):
        take_in(trial, "acme!")


def test_lanes_stay_as_they_were_planned(trial):
    lanes = trial / "lanes.toml"
    lanes.write_text(lanes.read_text().replace("30.0", "29.0"))
    with pytest.raises(ValueError, match=r"lanes must be those of the plan in .*register.jsonl"):
        take_in(trial)


def test_a_list_without_ranks_says_so_in_the_verdict(trial):
    pd.read_csv(trial.parent / "acme.csv")[["x", "y"]].to_csv(trial.parent / "p.csv", index=False)
    with pytest.raises(ValueError, match="alarms must have the columns confidence"):
        take_in(trial, name="p.csv")
    shown = take_in(trial, name="p.csv", unranked=True)
    assert "All confidences are equal (1): the list has one operating point" in shown.read.doubts
    trial_verdict(trial, passphrase=PHRASE)
    assert "<td>equal</td>" in (trial / "verdict.html").read_text()


def test_without_a_signed_list_there_is_no_verdict(trial):
    with pytest.raises(ValueError, match="a verdict must have a signed list, got none"):
        trial_verdict(trial, passphrase=nobody)
    (trial / "truth.sealed").unlink()
    take_in(trial)
    with pytest.raises(FileNotFoundError, match="sealed truth not found"):
        trial_verdict(trial, passphrase=nobody)


@pytest.mark.parametrize("name", ["verdict.html", "verdict.json"])
def test_a_verdict_that_cannot_be_written_costs_no_look(trial, name):
    take_in(trial)
    count = len(read_register(trial / "register.jsonl"))
    for make in ((trial / name).mkdir, lambda: (trial / name).symlink_to(trial / "elsewhere")):
        make()
        with pytest.raises(FileExistsError, match=name):
            trial_verdict(trial, passphrase=nobody)
        (trial / name).unlink() if (trial / name).is_symlink() else (trial / name).rmdir()
    assert len(read_register(trial / "register.jsonl")) == count


def test_a_truth_that_nobody_planned_is_sealed_with_the_trial(tmp_path):
    pytest.importorskip("cryptography")
    home = tmp_path / "t"
    trial_new(home, pd_claim=0.5, lane=short_lane(home))
    (home / "truth.csv").write_text(
        "target_id,kind,x,y,depth\nA,metal,0,10,0.1\nB,metal,1,20,0.1\n"
    )
    seal(home / "truth.csv", home / "lanes.toml", home / "truth.sealed", passphrase=PHRASE)
    (tmp_path / "acme.csv").write_text("x,y,confidence\n0,10,1\n")
    trial_intake(home, "ACME", tmp_path / "acme.csv", "A. Director")
    words = trial_verdict(home, passphrase=PHRASE).in_words()
    assert "ACME 1 of 2; it does not show Pd >= 0.5" in words
    assert words.endswith("none could, for that takes 5 mines without a miss.")
