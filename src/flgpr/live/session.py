"""Live detection: a run that comes in scan by scan.

Scans come from a folder, over sockets or from a recording; alarms go to a file of events and to a
callback.

Where a scan with a bad pose goes: a frame becomes a scan, or is left out, in ``live/intake.py``.
One without a pose, or with numbers that cannot be a pose (``pose_fault`` of
``store/scan_file.py``), has it filled in there from its neighbours', or is left out where they do
not tell it. The detector (``live/detector.py``, ``add``) asks the gate of ``model/plausible.py``
whether to believe a pose, and takes the scan in, leaves it out, or holds it back
(``LiveDetector.held``) until others agree with it or it is dropped. What is said of it:
``position_events`` in ``live/events.py``; how many: ``Intake.settled``.
"""

from __future__ import annotations

import os
import queue
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

import flgpr
from flgpr.door import Folder
from flgpr.geo import read_anchor
from flgpr.geo.anchor import check_same_place
from flgpr.live.alarm_reports import AlarmReporter
from flgpr.live.begin_and_end import (
    RECIPE_FILE,
    REPORT_FILE,
    check_output,
    rehearse,
    sentences_at_end,
    snapshot_to_go_on,
)
from flgpr.live.causal_steps import check_causal
from flgpr.live.detector import LiveDetector
from flgpr.live.earlier_drives import open_earlier
from flgpr.live.event_types import (
    EndEvent,
    Event,
    ProblemEvent,
    ResumeEvent,
)
from flgpr.live.events import (
    EVENT_FILE,
    EventFile,
    anew_event,
    ground_event,
    health_events,
    position_events,
    problem_event,
    scan_event,
    start_event,
    view_event,
)
from flgpr.live.forecast import forecast_of
from flgpr.live.intake import Intake
from flgpr.live.options import LiveOptions, LiveReport, Pace
from flgpr.live.senders import SENDERS, SocketWatch, TcpWatch, largest_frame
from flgpr.live.sockets import TcpAddress, live_secret, parse_tcp
from flgpr.live.source import SOCKET, Arrival, FolderWatch, Inbox, RunPlayer, Source
from flgpr.live.state import (
    SNAPSHOT_FILE,
    Snapshot,
    SnapshotWriter,
    restore_snapshot,
    take_snapshot,
)
from flgpr.live.updates import LiveUpdate, SettledOutcome
from flgpr.method.memory import check_scan_memory
from flgpr.method.model import Model, of_another_array, parse_model, read_model, unlearnt
from flgpr.method.unlike import Comparison, why_not
from flgpr.model import Lane
from flgpr.model.vehicle import Vehicle
from flgpr.recipe.make import fit_recipe, with_earlier
from flgpr.recipe.schema import Recipe, load_recipe, parse_recipe, recipe_text
from flgpr.stages.earlier import BEFORE
from flgpr.store import (
    RunDescription,
    Scan,
    ScanFileError,
    as_run,
    canonical_json,
    parse_description,
    read_lane,
    read_manifest,
    sha256,
)
from flgpr.store.answers import drop_answers
from flgpr.store.files import PARTIAL, write_whole
from flgpr.store.notes import log_note
from flgpr.store.outputs import locked_folder, log_finished
from flgpr.store.scan_file import RUN_FILE
from flgpr.store.writing import write_table

_NO_POSE = "left out: no scan with a pose has come yet, and a recipe needs the array's height"
_TICK = 0.1  # s between checks of the clock while nothing comes
# Counts of what is as it should be; the others are faults.
_NO_FAULT = ("received", "taken", "warm_up")
_OTHER_OPTIONS = (
    "it goes on with other options of the vehicle, the threshold, the anchor or worth: what was told "
    "before stands as it was"
)
_ANOTHER_END = "a sender of another run ended: this run goes on"
# By whether no earlier drive covers the road.
_COVER = {
    True: "no earlier drive lies near from here on: nothing is subtracted, what is old stands out, too",
    False: "earlier drives cover the road again",
}


class LiveRun:
    """A live run: sources, detector, events and snapshots.

    Parameters
    ----------
    options : LiveOptions
        Sources, output, recipe and model.
    tell : callable
        Called with every line about an alarm.

    Raises
    ------
    ValueError
        If an option is not valid; nothing is written then.
    """

    def __init__(self, options: LiveOptions, tell: Callable[[str], None] = lambda _: None) -> None:
        self.options = options
        self._tcp = None if options.tcp is None else parse_tcp(options.tcp)
        self._secret = None if options.tcp is None else live_secret(options.secret_file)
        #: where it listens, once it does
        self.listens_on: TcpAddress | None = None
        #: what the driver is told by
        self.vehicle = options.vehicle or Vehicle()
        if options.vehicle is None and options.recipe is not None:
            self.vehicle = load_recipe(options.recipe).vehicle
        self._alarms = AlarmReporter(self.vehicle, options.worth, tell)
        digest = ""
        self._model = Model()
        if options.model is not None:
            model_data = read_model(options.model)
            digest = sha256(model_data)
            self._model = parse_model(model_data, options.model)
        self._before, self._of_before = open_earlier(options.before)
        self._is_alone = False  # whether the newest scan lies near none of an earlier drive
        self._recipe: Recipe | None = None
        self._lane: Lane | None = None if options.lane is None else read_lane(options.lane)
        if options.anchor is not None:
            self._alarms.anchor = read_anchor(options.anchor)
        # what a snapshot must agree with, beside the run
        self._identity: dict[str, Any] = {
            "model": digest,
            "lane": None if self._lane is None else asdict(self._lane),
            "flgpr": flgpr.__version__,
            "settings": asdict(options.settings),
        }
        if options.before:
            self._identity["before"] = [read_manifest(run)["sha256"] for run in options.before]
        # what alarms are told by, which a later process may change
        self._told_by = {
            "vehicle": self.vehicle.model_dump(),
            "worth": options.worth,
            "anchor": None if self._alarms.anchor is None else self._alarms.anchor.georeference(),
        }
        self.output = Path(options.output)
        self.inbox = Inbox()
        self._pace = Pace()
        self._names: set[str] = set()
        self._senders: Counter[str] = Counter()
        self._detector: LiveDetector | None = None
        self._intake: Intake | None = None
        self._fingerprint = ""
        self._started = False
        if options.recipe is not None:
            text = recipe_text(options.recipe)
            self._use_recipe(with_earlier(text) if self._before else text, str(options.recipe))

    def _use_recipe(self, text: str, source: str) -> Recipe:
        """Check that the recipe of a text can work scan by scan with the model, and use it."""
        recipe = parse_recipe(text, source)
        check_causal(recipe)
        unlearnt(recipe, self._model)
        self._recipe = recipe
        self._alarms.forecast = forecast_of(recipe, self._model)
        self._identity["recipe"] = sha256(text.encode())
        return recipe

    def _fit_recipe(self, scan: Scan, description: RunDescription, events: EventFile) -> Recipe:
        """Make a recipe for the run from its description and its first scan with a pose.

        It is kept in the output folder, from where a later process takes it.
        """
        run = as_run(description, scan)
        text = fit_recipe(run, begins=True, again=bool(self._before))
        recipe = self._use_recipe(text, "fitted")
        write_whole(self.output / RECIPE_FILE, text)
        words = f"no recipe was given: {RECIPE_FILE} was made for this run and is used"
        events.append([problem_event(RECIPE_FILE, words)])
        return recipe

    def stop(self) -> None:
        """Let :meth:`run` end after the scan that it processes."""
        self.inbox.stop.set()

    def run(self) -> LiveReport:
        """Process scans until the run ends, :meth:`stop` is called or nothing comes for too long.

        Raises
        ------
        FileExistsError
            If the output folder holds other files.
        ValueError
            If another live run writes to the output, or the scans are of another run than the
            snapshot.
        """
        check_output(self.output)
        self.output.mkdir(parents=True, exist_ok=True)
        with locked_folder(self.output):
            for partial in self.output.glob(f"*{PARTIAL}"):  # of a process that was killed
                partial.unlink()
            return self._run()

    def _run(self) -> LiveReport:
        """Start sources and detector, from a snapshot where there is one, and process scans."""
        options = self.options
        path = self.output / SNAPSHOT_FILE
        snapshot = snapshot_to_go_on(path, options)
        sources: list[Source] = []
        if options.socket is not None:
            sources.append(SocketWatch(Path(options.socket), self.inbox))
        if self._tcp is not None:
            sources.append(self._listen_on_tcp(self._tcp))
        known = set(snapshot[0]["names"]) if snapshot else None
        if options.played is not None:
            sources.append(RunPlayer(options.played, self.inbox, options.rate, known))
        new_events = snapshot is None
        if new_events:
            dropped = drop_answers(self.output)
            if dropped:
                log_note(
                    f"{dropped} answers of drivers to the run before are removed: it begins anew"
                )
        with (
            EventFile(self.output / EVENT_FILE, new_events) as events,
            SnapshotWriter(path) as writer,
        ):
            if options.incoming is not None:
                sources.append(FolderWatch(Path(options.incoming), self.inbox, known))
            if snapshot is not None:
                self._describe(parse_description(snapshot[0]["run"]), events, snapshot)
            for source in sources:
                source.start()
            try:
                failed = self._loop(events, writer)
            finally:
                self.inbox.stop.set()
                for source in sources:
                    source.join(2.0)
            report = self._finish(events, writer)
        if failed is not None:
            raise ValueError(f"{failed.name}: {failed.value}") from failed.value
        return report

    def _listen_on_tcp(self, address: TcpAddress) -> TcpWatch:
        """Return the source that listens on a TCP address, and note where that is."""
        watch = TcpWatch(address, self.inbox, secret=self._secret)
        self.listens_on = watch.address
        note = f"listens on {watch.address}"
        if self._secret is not None:
            note += ": senders must know the secret; nothing is encrypted"
        elif not watch.address.is_loopback:
            note += (
                ": whoever reaches this address may send scans and end the run, and nothing is "
                "encrypted; a secret keeps others out (--secret-file)"
            )
        log_note(note)
        return watch

    def _loop(self, events: EventFile, writer: SnapshotWriter) -> Arrival | None:
        """Process arrivals one by one until the run ends; return what failed, if a source did."""
        last = time.monotonic()
        scans_since_snapshot = 0
        while not self.inbox.stop.is_set():
            events.beat()
            self._report_senders(events)
            try:
                arrival = self._next()
            except queue.Empty:
                idle = time.monotonic() - last
                if self.options.idle is not None and idle > self.options.idle:
                    return None
                continue
            last = time.monotonic()
            if arrival.kind == "failed":
                return arrival
            if arrival.kind == "end":
                if self._is_over(arrival, events):
                    return None
            elif arrival.kind == "run":
                self._take_description(arrival, events)
            elif self._take_frame(arrival, events):
                scans_since_snapshot += 1
                if self.options.snapshot and scans_since_snapshot >= self.options.snapshot:
                    scans_since_snapshot = 0
                    writer.offer(self._snapshot())
        return None

    def _next(self) -> Arrival:
        """Return what arrives within a tick, else raise queue.Empty."""
        self.inbox.awaited = True
        try:
            return self.inbox.arrivals.get(timeout=_TICK)
        finally:
            self.inbox.awaited = False

    def _report_senders(self, events: EventFile) -> None:
        """Write events of senders on the socket that were refused or ended."""
        senders = self.inbox.take_senders()
        for outcome, count in senders.items():
            name = f"senders_{outcome}"
            self._senders[name] += count
            words = f"senders {outcome}: {count}, {self._senders[name]} in all; {SENDERS[outcome]}"
            events.append([problem_event(SOCKET, words)])

    def _take_description(self, arrival: Arrival, events: EventFile) -> None:
        """Take a description of this run.

        The first one, or one again from a sender that connected anew.
        """
        try:
            description = parse_description(arrival.value)
            if self._intake is None:
                self._describe(description, events, None)
            elif self._intake.description.run_id != description.run_id:
                raise ScanFileError("the description is that of another run")
        except ValueError as error:
            if arrival.name != SOCKET:
                raise ValueError(f"{arrival.name}: {error}") from None
            events.append([problem_event(arrival.name, str(error))])

    def _is_over(self, end: Arrival, events: EventFile) -> bool:
        """Return whether the end that a sender states is that of this run.

        It is not where the sender described another run, or sent its scans; after a restart it need
        not describe its run again. Where it states more scans than came, that is told: the first or
        the last ones may be missing.
        """
        intake = self._intake
        described = "" if intake is None else intake.description.run_id
        if end.name == SOCKET and end.value not in ("", described):
            events.append([problem_event(end.name, _ANOTHER_END)])
            return False
        lacking = "" if intake is None else intake.lacking(end.stated_scans)
        if lacking:
            events.append([problem_event(end.name, lacking)])
            log_note(lacking)
        return True

    def _describe(
        self, description: RunDescription, events: EventFile, snapshot: Snapshot | None
    ) -> None:
        """Build the detector of the run, and continue from a snapshot where there is one.

        Without a recipe the detector is built when a scan with a pose has come, see
        :meth:`_fit_recipe`, unless an earlier process has made one.
        """
        anchor = self._alarms.anchor
        own = description.attrs.get("georeference") if anchor is None else anchor.georeference()
        for path, earlier in zip(self.options.before, self._before.values(), strict=True):
            check_same_place(own, earlier.attrs.get("georeference"), path)
        recipe = self._recipe
        if recipe is None and not self.options.fresh:
            made_before = Folder(self.output).read_if_listed(RECIPE_FILE)
            if made_before is not None:
                recipe = self._use_recipe(made_before.decode("utf-8"), RECIPE_FILE)
        if recipe is None and snapshot is not None:
            raise ValueError(
                f"recipe must be given to go on with {self.output}, which holds no {RECIPE_FILE}; "
                "`fresh` begins again"
            )
        if recipe is None:
            self._intake = Intake(description)
        else:
            intake = Intake(description, limits=recipe.motion)
            self._build(recipe, intake, events, snapshot)
        # Only of a description that is taken: another one leaves nothing behind.
        self.inbox.largest = largest_frame(description)
        untied = self._alarms.use_georeference(description.attrs.get("georeference"))
        if untied:
            events.append([problem_event(RUN_FILE, untied)])

    def _build(
        self, recipe: Recipe, intake: Intake, events: EventFile, snapshot: Snapshot | None
    ) -> LiveDetector:
        """Build the detector of a recipe, and continue from a snapshot where there is one."""
        description = intake.description
        self._fingerprint = sha256(canonical_json(self._identity | {"run": description.run_id}))
        check_scan_memory(description.shape, recipe)
        detector = LiveDetector(
            description, recipe, self._lane, self._model, self.options.settings, self._before
        )
        if snapshot is not None:
            self._names = restore_snapshot(snapshot, detector, intake, self._fingerprint)
            self._alarms.resume(detector.alarms.open)
            is_told_so = snapshot[0].get("told_by", self._told_by) == self._told_by
            # Another start states what alarms are told by from here on.
            self._started = detector.first_pose is not None and is_told_so
            resumed: ResumeEvent = {
                "event": "resume",
                "scan": detector.newest_number,
                "counts": intake.counts,
            }
            events.append([resumed])
            if not is_told_so:
                events.append([problem_event("vehicle", _OTHER_OPTIONS)])
                log_note(_OTHER_OPTIONS)
        cannot_judge = why_not(self._model.ground)
        if cannot_judge and (self._model.detector is not None or self._model.stages):
            log_note("; ".join(Comparison(cannot=cannot_judge).notes()))
        events.append([problem_event(one.run, one.sentence) for one in self._of_before])
        rehearse(description, recipe, self._model, self._before)
        intake.health.lane = detector.lane
        self._detector = detector
        self._intake = intake
        return detector

    def _take_frame(self, arrival: Arrival, events: EventFile) -> bool:
        """Process a frame; return whether it held a scan that was judged."""
        detector = self._detector
        intake = self._intake
        if intake is None:
            reason = arrival.value or "left out: it came before the description of its run"
            events.append([problem_event(arrival.name, str(reason))])
            return False
        if arrival.name != SOCKET:
            self._names.add(arrival.name)
        counts_before = dict(intake.counts)
        lines: list[Event] = []
        scan = None
        problem = ""
        try:
            scan = intake.admit(arrival.data, arrival.value)
        except ScanFileError as error:
            problem = str(error)
        health = health_events(arrival.name, intake.findings, intake.newest)
        if detector is None:
            if scan is None:
                events.append(health)
                reasons = [problem] if problem else [intake.pose_report, _NO_POSE]
                problems = [problem_event(arrival.name, reason) for reason in reasons if reason]
                events.append(problems)
                return False
            recipe = self._fit_recipe(scan, intake.description, events)
            detector = self._build(recipe, intake, events, None)
        lines += health
        if intake.pose_report:
            lines.append(problem_event(arrival.name, intake.pose_report))
        update = None
        if scan is not None:
            update, problem = self._judge(scan, detector, intake)
        if scan is not None and update is not None:
            lines += self._update_events(scan, update, arrival, detector, intake)
        if problem:
            lines.append(problem_event(arrival.name, problem))
        lines += self._cover_events(detector, intake)
        if _faults(counts_before) != _faults(intake.counts):
            lines.append({"event": "counts", **intake.counts})
        events.append(lines)
        detector.learn()
        self._pace.take_frame()
        return scan is not None

    def _update_events(
        self,
        scan: Scan,
        update: LiveUpdate,
        arrival: Arrival,
        detector: LiveDetector,
        intake: Intake,
    ) -> list[Event]:
        """Return the events of what a scan changed, and of the scans held back that it released."""
        latency = max(time.time() - arrival.when, 0.0)
        lines: list[Event] = [*position_events(arrival.name, update)]
        pose = detector.newest_pose if detector.newest_pose is not None else scan.pose
        if update.anew and pose is not None:
            lines.append(anew_event(scan.number, update, pose))
            self._started = self._started and detector.lane is not None and not update.forgotten
            self._alarms.keep_open(detector.alarms.open)
        if update.outcome in ("held", "implausible", "duplicate"):
            return lines
        if not self._started and detector.first_pose is not None:
            self._started = True
            reference = intake.description.attrs.get("georeference")
            anchor = self._alarms.anchor
            if self.options.anchor is not None and anchor is not None:
                reference = anchor.georeference()
            lines.append(start_event(detector, reference, self.vehicle))
            placed = replace(scan, pose=detector.first_pose)
            another = of_another_array(self._model, as_run(intake.description, placed))
            if another:
                log_note(another)
                lines.append(problem_event(RUN_FILE, another))
        settled = [*update.released, (scan, update)]
        for settled_scan, change in settled:
            # Scans that are released, and one that was not left out, are settled.
            outcome = cast("SettledOutcome", change.outcome)
            lines.append(scan_event(settled_scan, outcome, arrival.when, latency))
        for settled_scan, change in settled:
            if change.ground is not None:
                ground = ground_event(settled_scan.number, change.ground)
                lines.append(ground)
                self._alarms.send(ground)
        if pose is not None:
            lines += self._alarms.events(update, scan.number, pose, latency, detector)
        for _, change in settled:
            if change.view is not None:
                lines.append(view_event(change.row, change.view))
        if update.outcome == "taken":
            self._pace.took(latency)
        return lines

    def _judge(
        self, scan: Scan, detector: LiveDetector, intake: Intake
    ) -> tuple[LiveUpdate | None, str]:
        """Return what a scan changed and what is wrong with it."""
        newest = detector.newest_number
        try:
            update = detector.add(scan)
        except ValueError as error:
            intake.settled(len(detector.held), detector.left_out)
            intake.judged(scan.number, "refused", newest)
            return None, str(error)
        intake.settled(len(detector.held), detector.left_out, update.anew, update.forgotten)
        intake.counts["clock"] += update.clock is not None
        for released_scan, change in update.released:
            intake.judged(released_scan.number, change.outcome, None)
        intake.judged(scan.number, update.outcome, None if update.anew else newest)
        return update, update.words

    def _cover_events(self, detector: LiveDetector, intake: Intake) -> list[ProblemEvent]:
        """Return the event that earlier drives cover the road no more, or again; count such scans."""
        earlier = detector.earlier
        if earlier is None:
            return []
        intake.counts["without_earlier"] = earlier.alone
        if earlier.is_alone == self._is_alone:
            return []
        self._is_alone = earlier.is_alone
        return [problem_event(BEFORE, _COVER[earlier.is_alone])]

    def _snapshot(self) -> Snapshot:
        """Return the state of detector and intake."""
        if self._detector is None or self._intake is None:
            raise ValueError("a snapshot needs a run, got none")
        if self.options.incoming is not None and os.path.isdir(self.options.incoming):
            # Files that were removed cannot be read again and need not be remembered.
            self._names.intersection_update(os.listdir(self.options.incoming))
        snapshot = take_snapshot(self._detector, self._intake, self._names, self._fingerprint)
        snapshot[0]["told_by"] = self._told_by
        return snapshot

    def _finish(self, events: EventFile, writer: SnapshotWriter) -> LiveReport:
        """Write the last snapshot, the alarms and the report."""
        detector = self._detector
        intake = self._intake
        if detector is None or intake is None:
            return Pace().report({} if intake is None else dict(intake.counts), 0)
        self._report_senders(events)
        for name, count in self._senders.items():
            intake.counts[name] += count
        writer.last(self._snapshot())
        counts = dict(intake.counts)
        table = detector.table()
        came = self._pace.frames > 0
        if not came and (self.output / REPORT_FILE).is_file():
            log_finished(self.output, "`fresh` makes it again")
            return Pace().report(counts, len(table))
        write_table(table, self.output / "alarms.csv")
        report = self._pace.report(counts, len(table))
        for name, sentences in sentences_at_end(detector, came).items():
            events.append([problem_event(name, sentence) for sentence in sentences])
            log_note("; ".join(sentences))
        end: EndEvent = {"event": "end", "alarms": len(table), "latency": report.latency_ms}
        events.append([{**end, **counts}])
        stated_rate = report.rate if np.isfinite(report.rate) else None
        entries = asdict(report) | {"rate": stated_rate, "recipe": detector.recipe.name}
        write_whole(self.output / REPORT_FILE, canonical_json(entries) + b"\n")
        return report


def _faults(counts: dict[str, int]) -> dict[str, int]:
    """Return the counts of what is not as it should be."""
    return {name: count for name, count in counts.items() if name not in _NO_FAULT}
