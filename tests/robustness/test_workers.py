"""Who does the work, and how often it is stopped, does not change a byte."""

import json
import multiprocessing
import os
import re
import shutil
import signal
import threading
import time

import numba
import pandas as pd
import pytest

import flgpr
from flgpr import engine
from flgpr.engine import Engine
from flgpr.imaging import ScanImager
from flgpr.jobs import checkpoint
from flgpr.jobs.checkpoint import WorkError, begin
from flgpr.jobs.driver import detect_lane, passes_of_lane
from flgpr.jobs.pieces import do_block
from flgpr.jobs.workers import InProcess, LostWorkersError, Processes, RunOptions
from flgpr.store import sample_lane, save_run
from robust import content, digests, small_job


@pytest.mark.parametrize("workers", [1, 4])
def test_worker_count_does_not_change_a_byte(lane, workers, tmp_path):
    result = flgpr.detect(
        *lane.arguments, tmp_path / "result", lane.area, workers=workers, report=False
    )
    assert content(result.folder) == lane.content
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]


@pytest.mark.slow("detects on a lane several times")
@pytest.mark.parametrize("threads", [1, 2, 4])
def test_thread_count_does_not_change_a_byte(lane, threads, tmp_path, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: threads)
    at_work = set()
    part = Engine.gather_block

    def watched(*arguments):
        at_work.add(threading.current_thread().name)
        return part(*arguments)

    monkeypatch.setattr(Engine, "gather_block", watched)
    reports = []
    result = flgpr.detect(
        *lane.arguments, tmp_path / "result", lane.area, report=False, note=reports.append
    )
    assert content(result.folder) == lane.content
    assert len(reports) == 4 * (lane.blocks + 1) + 2
    assert (len(at_work) > 1) is (threads > 1)
    assert ("MainThread" in at_work) is (threads < 4)  # of three blocks two threads leave one


def test_a_broken_scan_ends_the_run_by_its_name_and_mended_it_goes_on(lane, tmp_path, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: 2)
    run = tmp_path / "run.zarr"
    output = tmp_path / "result"
    shutil.copytree(lane.run, run)
    [chunk] = [path for path in (run / "signal" / "c" / "20").rglob("*") if path.is_file()]
    data = chunk.read_bytes()
    chunk.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    with pytest.raises(ValueError, match="signal/c/20"):
        flgpr.detect(run, lane.recipe, output, lane.area, report=False)
    assert not output.exists()
    chunk.write_bytes(data)
    assert (
        content(flgpr.detect(run, lane.recipe, output, lane.area, report=False).folder)
        == lane.content
    )


def test_lanes_of_a_survey_are_worked_on_where_an_interrupt_arrives(lane, tmp_path, monkeypatch):
    def interrupted(*_):
        assert threading.current_thread() is threading.main_thread()
        raise KeyboardInterrupt

    monkeypatch.setattr("flgpr.jobs.survey.detect_lane", interrupted)
    second = tmp_path / "second.zarr"
    shutil.copytree(lane.run, second)
    with pytest.raises(KeyboardInterrupt):
        flgpr.detect([lane.run, second], lane.recipe, tmp_path / "out", [lane.area, lane.area])


@pytest.mark.slow("runs the demo four times")
@pytest.mark.parametrize("recipe", ["demo", "demo-roadside-suppressed"])
def test_the_demo_has_the_same_bytes_whoever_works_and_after_a_stop(recipe, tmp_path):
    """The roadside fitted and kept by blocks, no features: three scans in a single block."""
    run = sample_lane() / "run.zarr"
    plain = flgpr.detect(run, recipe, tmp_path / "plain", report=False)
    both = flgpr.detect(run, recipe, tmp_path / "both", report=False, workers=2)
    assert content(both.folder) == content(plain.folder)
    done = []

    def stop(report):
        done.append(report["stage"])
        if len(done) == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flgpr.detect(run, recipe, tmp_path / "stopped", report=False, note=stop)
    before = done.copy()
    flgpr.detect(
        run,
        recipe,
        tmp_path / "stopped",
        report=False,
        note=lambda report: done.append(report["stage"]),
    )
    assert content(tmp_path / "stopped") == content(plain.folder)
    assert not set(done[len(before) :]) & set(before[:-1])


def test_detection_in_memory_finds_the_same(lane):
    from flgpr.method.method import detect
    from flgpr.recipe.schema import load_recipe
    from flgpr.store import open_run

    found = detect(open_run(lane.run), load_recipe(lane.recipe), lane.lane)
    pd.testing.assert_frame_equal(
        found.alarms, lane.result.detections[0].alarms, check_dtype=False, rtol=1e-12
    )
    pd.testing.assert_frame_equal(found.features, lane.features, check_dtype=False, rtol=1e-12)


@pytest.mark.slow("waits for processes to end")
def test_a_killed_worker_process_costs_only_its_piece(lane, tmp_path):
    """Kill one of two workers when half is done: the others' pieces are not done again."""
    done = []
    victims = []

    def note(report):
        done.append((report["stage"], report["block"]))
        if len(done) == 6 and not victims:
            victims.append(int(report["worker"].split(":")[1]))
            os.kill(victims[0], signal.SIGKILL)

    result = flgpr.detect(
        *lane.arguments, tmp_path / "result", lane.area, workers=2, report=False, note=note
    )
    assert content(result.folder) == lane.content
    assert len(victims) == 1
    assert len(done) == len(set(done)) == 4 * (lane.blocks + 1) + 2


@pytest.mark.slow("waits for processes to end")
def test_workers_end_when_their_driver_is_killed(lane, tmp_path):
    context = multiprocessing.get_context("forkserver")
    ours, theirs = context.Pipe()
    driver = context.Process(target=_drive, args=(theirs,))
    driver.start()
    assert ours.poll(120)
    pids = ours.recv()
    driver.kill()
    driver.join()
    end = time.monotonic() + 20
    while any(_alive(pid) for pid in pids) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(_alive(pid) for pid in pids)


def _drive(pipe):
    with Processes(2) as pool:
        pipe.send([report["pid"] for report in pool.run(_pid, [(), ()])])
        time.sleep(60)


def _pid():
    time.sleep(0.3)
    return {"pid": os.getpid()}


def _alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except (
        FileNotFoundError,
        ProcessLookupError,
    ):  # the second: it went between opening and reading
        return False


def test_an_error_of_a_worker_is_the_drivers(lane, tmp_path):
    with Processes(1) as pool, pytest.raises(ValueError, match="not here"):
        list(pool.run(_fail, [()]))


def test_workers_that_are_killed_again_and_again_are_told(lane):
    with Processes(1) as pool, pytest.raises(LostWorkersError, match="3 times"):
        list(pool.run(_die, [()]))


def _die():
    os.kill(os.getpid(), signal.SIGKILL)


def _fail():
    raise ValueError("not here")


@pytest.mark.slow("runs a survey of several lanes again and again")
def test_a_survey_is_one_command_and_goes_on_where_it_stopped(lane, tmp_path):
    run = lane.opened.load()
    shutil.copytree(lane.run, tmp_path / "a.zarr")
    save_run(run.isel(scan=slice(0, 30)), tmp_path / "b.zarr")
    done = []
    where = [tmp_path / "a.zarr", tmp_path / "b.zarr"], lane.recipe, tmp_path / "out"
    options = {
        "lane": [lane.area, lane.area],
        "report": False,
        "workers": 2,
        "note": done.append,
    }
    first = flgpr.detect(*where, **options)
    assert content(first.folders[0]) == lane.content
    assert {report["lane"] for report in done} == {"a", "b"}
    told = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert [row["lane"] for row in told] == ["a", "b"]
    assert [row["scans"] for row in told] == [36, 30]
    (tmp_path / "out" / "b" / "alarms.csv").unlink()
    done.clear()
    again = flgpr.detect(*where, **options)
    assert {report["lane"] for report in done} == {"b"}
    assert content(again.folders[1]) == content(first.folders[1])
    with pytest.raises(ValueError, match="different names"):
        flgpr.detect([tmp_path / "a.zarr", tmp_path / "a.zarr"], lane.recipe, tmp_path / "out2")
    with pytest.raises(ValueError, match="lanes_at_once needs workers"):
        flgpr.detect(*where, lanes_at_once=2)


def test_a_work_folder_of_another_job_is_begun_anew_and_one_in_use_is_left_alone(lane, tmp_path):
    job = small_job(lane, tmp_path / "result")
    with begin(job.work, {"job": 1}) as work:
        work["signature"] = {"a": lane.opened["frequency"].values}
        with pytest.raises(WorkError, match="another process"), begin(job.work, {"job": 1}):
            pass
    with begin(job.work, {"job": 1}) as work:
        assert list(work) == ["signature"]
    with begin(job.work, {"job": 2}) as work:
        assert list(work) == []
    (job.work / "notes.txt").write_text("mine")
    with pytest.raises(FileExistsError, match=r"notes\.txt"), begin(job.work, {"job": 2}):
        pass


@pytest.mark.slow("detects on a lane several times")
def test_a_damaged_part_is_made_again(lane, tmp_path):
    """Whatever happens to the files of a work folder, the result is right or there is an error."""
    job = small_job(lane, tmp_path / "result")
    stopped = Stopper(3 * lane.blocks)
    with pytest.raises(KeyboardInterrupt):
        flgpr.detect(*lane.arguments, tmp_path / "result", lane.area, report=False, note=stopped)
    files = sorted(job.work.glob("*.arrays"))
    assert len(files) >= 3
    for file, at in zip(files, (5, 200, -9), strict=False):
        data = bytearray(file.read_bytes())
        data[at] ^= 1
        file.write_bytes(data)
    result = flgpr.detect(*lane.arguments, tmp_path / "result", lane.area, report=False)
    assert content(result.folder) == lane.content


class Stopper:
    def __init__(self, after):
        self.left = after

    def __call__(self, report):
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


@pytest.mark.slow("trains several times")
def test_a_training_that_was_stopped_goes_on_and_does_not_depend_on_who_works(
    lane, tmp_path, monkeypatch
):
    truth = tmp_path / "truth.csv"
    truth.write_text(
        "target_id,kind,x,y,depth\na,metal,0.2,4.5,0.0\nb,metal,-0.4,6.3,0.0\nc,metal,0.3,8.4,0.0\n"
    )
    columns = ("C_HH_F1", "M_VV_F1")
    where = [lane.run, lane.run], [truth, truth], lane.recipe
    options = {"lanes": [lane.area, lane.area]}
    flgpr.train(*where, tmp_path / "plain", columns, **options, workers=2)

    calls = []

    def stopped(job, *rest, **names):
        calls.append(job)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return passes_of_lane(job, *rest, **names)

    monkeypatch.setattr("flgpr.jobs.training.passes_of_lane", stopped)
    with pytest.raises(KeyboardInterrupt):
        flgpr.train(*where, tmp_path / "model", columns, **options)
    assert [path.name for path in tmp_path.glob("model*")] == ["model-1-1.work"]
    monkeypatch.undo()
    monkeypatch.setattr(
        Engine, "gather_block", _only_of(tmp_path / "model-2-1.work", Engine.gather_block)
    )
    flgpr.train(*where, tmp_path / "model", columns, **options)
    assert digests(tmp_path / "model") == digests(tmp_path / "plain")
    assert [path.name for path in tmp_path.glob("model*")] == ["model"]


def _only_of(folder, part):
    """Let blocks be worked on for one work folder only."""

    def checked(chain, *arguments):
        assert chain.results.folder == folder
        return part(chain, *arguments)

    return checked


def test_a_training_that_would_overwrite_other_files_begins_nothing(lane, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    truth = tmp_path / "truth.csv"
    truth.write_text("target_id,kind,x,y,depth\na,metal,0.2,4.5,0.0\n")
    with pytest.raises(FileExistsError, match="other files"):
        flgpr.train([lane.run], [truth], lane.recipe, tmp_path / "mine", lanes=[lane.area])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine", "truth.csv"]


def test_a_stop_within_a_block_costs_the_scan_in_flight(lane, tmp_path, monkeypatch):
    """A stop in each of the four passes: every scan of every pass is made once, but for the four that were stopped."""
    monkeypatch.setattr(checkpoint, "KEEP_EVERY", 0.0)
    count = 0
    image = ScanImager.image
    stops = (2, 40, 75, 120)

    def counted(imager, *arguments):
        nonlocal count
        count += 1
        if count in stops:
            raise KeyboardInterrupt
        return image(imager, *arguments)

    monkeypatch.setattr(ScanImager, "image", counted)
    job = small_job(lane, tmp_path / "result")
    with InProcess() as executor:
        for _ in stops:
            with pytest.raises(KeyboardInterrupt):
                detect_lane(job, executor)
        detect_lane(job, executor)
    assert count == 4 * 36 + len(stops)
    assert content(tmp_path / "result") == lane.content
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def merge_often(job, stage, number):
    """Do a part in a process that merges parts as soon as there are any."""
    checkpoint.MERGE_BYTES = 1
    return do_block(job, stage, number)


class Merging(Processes):
    def run(self, work, arguments, threads=1):
        return super().run(merge_often if work is do_block else work, arguments, threads)


@pytest.mark.slow("detects on a lane of many blocks several times")
def test_parts_that_are_merged_as_they_come_do_not_change_a_byte(lane, tmp_path):
    """As soon as there are any, beside others at work in other processes."""
    with Merging(2) as executor:
        detect_lane(small_job(lane, tmp_path / "result"), executor)
    assert content(tmp_path / "result") == lane.content


@pytest.mark.slow("detects on a lane of many blocks several times")
@pytest.mark.parametrize("threads", [1, 4])
def test_the_work_folder_of_many_blocks_holds_few_parts(lane, threads, tmp_path, monkeypatch):
    """Nine blocks, merged once they are twice as large as what is merged already: more than once, one by one."""
    monkeypatch.setattr(numba, "get_num_threads", lambda: threads)
    monkeypatch.setattr(engine, "BLOCK", 4)
    held = {"signature": [], "gain": [], "view": []}
    merges = []
    put = checkpoint.Checkpoint.__setitem__

    def keep(work, name, arrays):
        put(work, name, arrays)
        merges.extend([name] if name == "signature-so-far" else [])

    def note(report):
        if report["stage"] in held:
            folder = tmp_path / "merged.work"
            held[report["stage"]].append(len(list(folder.glob(f"{report['stage']}-0*.arrays"))))

    with InProcess() as executor:
        detect_lane(small_job(lane, tmp_path / "plain"), executor)
        monkeypatch.setattr(checkpoint, "MERGE_BYTES", 1)
        monkeypatch.setattr(checkpoint.Checkpoint, "__setitem__", keep)
        detect_lane(small_job(lane, tmp_path / "merged"), executor, RunOptions(note=note))
    assert content(tmp_path / "merged") == content(tmp_path / "plain")
    assert max(held["signature"] + held["gain"]) <= 4 + threads < max(held["view"])
    assert len(merges) > (threads == 1)  # threads that end together leave it to one
    assert held["signature"][-1] == held["gain"][-1] == held["view"][-1] == 0


@pytest.mark.slow("detects on a lane of many blocks several times")
@pytest.mark.parametrize("damaged", [False, True])
def test_what_is_merged_already_is_not_done_again_unless_it_is_damaged(
    lane, damaged, tmp_path, monkeypatch
):
    monkeypatch.setattr(numba, "get_num_threads", lambda: 1)
    monkeypatch.setattr(checkpoint, "MERGE_BYTES", 1)
    done = []
    job = small_job(lane, tmp_path / "result")
    so_far = tmp_path / "result.work" / "signature-so-far.arrays"

    def stop(report):
        if report["block"] == 1:
            raise KeyboardInterrupt

    with InProcess() as executor:
        with pytest.raises(KeyboardInterrupt):
            detect_lane(job, executor, RunOptions(note=stop))
        if damaged:
            so_far.write_bytes(so_far.read_bytes()[:-1] + b"?")
        detect_lane(
            job,
            executor,
            RunOptions(note=lambda report: done.append((report["stage"], report["block"]))),
        )
    assert content(tmp_path / "result") == lane.content
    assert [block for stage, block in done if stage == "signature"] == (
        [0, 2, -1] if damaged else [2, -1]
    )


@pytest.mark.slow("detects on a lane of many blocks several times")
@pytest.mark.parametrize("confidence", ["contrast", "magnitude"])
def test_a_recipe_without_features_goes_on_as_well(lane, confidence, tmp_path, monkeypatch):
    """Images and a prescreener alone, with a contrast or without: stopped at every pass, each scan is made once."""
    text = re.sub(r"(?ms)^\[features\].*?(?=^\[)", "", lane.recipe.read_text())
    (tmp_path / "bare.toml").write_text(f'confidence = "{confidence}"\n{text}')
    monkeypatch.setattr(checkpoint, "KEEP_EVERY", 0.0)
    count = 0
    image = ScanImager.image
    ends = []

    def counted(imager, *arguments):
        nonlocal count
        count += 1
        if count in ends:
            raise KeyboardInterrupt
        return image(imager, *arguments)

    monkeypatch.setattr(ScanImager, "image", counted)
    where = lane.run, tmp_path / "bare.toml"
    flgpr.detect(*where, tmp_path / "whole", lane.area, report=False)
    once = count
    count = 0
    assert once == 4 * 36
    ends += [2, 40, 75, 120]
    for _ in ends:
        with pytest.raises(KeyboardInterrupt):
            flgpr.detect(*where, tmp_path / "result", lane.area, report=False)
    flgpr.detect(*where, tmp_path / "result", lane.area, report=False)
    assert count == once + len(ends)
    assert content(tmp_path / "result") == content(tmp_path / "whole")
    assert not (tmp_path / "result.work").exists()
