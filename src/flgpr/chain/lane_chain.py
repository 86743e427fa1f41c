"""The chain of every recipe as passes: clutter stages, self-signature, gain, run-view, features, explanations.

Every pass holds one scan at a time, so that runs may have any length. A recipe's variants are the same passes with one
thing done otherwise. A chain that is told a truth has, where its recipe learns, a pass that gathers examples and ends
there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.estimators import TrainedEstimator
from flgpr.chain.evidence import MOST_GATHERED, Evidence, EvidenceSums, caused, in_order
from flgpr.chain.gathering import AlarmFeatures, AlarmSums, check_confidence, look_sums
from flgpr.chain.images import RunImages
from flgpr.chain.memory import CACHE
from flgpr.chain.model import Detector, Model, as_model, unlearnt
from flgpr.chain.passes import Accumulator, Arrays, Chain, Pass, added, bundled, gathered, group_of
from flgpr.chain.recipe import Recipe, as_imaged
from flgpr.chain.roadside import Roadside
from flgpr.chain.sections import Section, kept_rows, lane_threshold
from flgpr.chain.stages import (
    ComplexArray,
    FeatureStage,
    MapStage,
    ScreenStage,
    Stage,
    make_stage,
)
from flgpr.clutter import Background, BackgroundEstimator, shared_level
from flgpr.imaging import ScanImager
from flgpr.io import sha256
from flgpr.model import ALARM_COLUMNS, Lane, empty_table
from flgpr.screen import RunViewSums, frame_alarms, local_maxima, select, view_array

MAIN = "main"
KINDS = {
    "signature": "self-signature", "gain": "gain background", "view": "run-view", "alarms": "alarms",
    "features": "features",
}  # fmt: skip
"""Passes of every way through, and what they are called."""
IMAGING = {"image", "background", "clutter", "suppression", "variants", "motion"}
"""Tables of a recipe that images and their backgrounds hang on; run-views and what follows hang on VIEWING, too."""
VIEWING = {"run_view", "contrast", "map"}
FloatArray = NDArray[np.float64]


class Variation(NamedTuple):
    """One way through the passes: the recipe's own, or a variant's."""

    name: str
    title: str
    signature: Any
    suppressed: bool = False

    def of(self, name: str) -> str:
        """Name its pass of a kind."""
        return name if self.name == MAIN else f"{name}.{self.name}"


def variations_of(recipe: Recipe) -> list[Variation]:
    """List a recipe's own way and its variants'."""
    own = recipe.background.self_signature
    others = (
        Variation(v.name, v.title, v.self_signature or own, v.suppress_roadside)
        for v in recipe.variants
    )
    return [Variation(MAIN, recipe.description, own), *others]


@dataclass(frozen=True)
class Detection:
    """What one chain found."""

    #: name, title: "main" for the recipe itself, else the variant's
    name: str
    title: str
    #: alarm table, the most mine-like first; ``roadside`` (main only, where the recipe suppresses the roadside) is the
    #: share of the alarm's amplitude that the modelled roadside response explains
    alarms: pd.DataFrame
    view: xr.DataArray  #: run-view (polarization, subband, y, x) in units of the gain background
    notes: dict[str, Any] = field(default_factory=dict)  #: figures worth reporting
    channel: tuple[str, str] | None = None  #: polarization and sub-band the alarms were raised on
    #: features, contributions: per alarm its features, and what each of them adds to the confidence
    features: pd.DataFrame | None = None
    contributions: pd.DataFrame | None = None
    training: pd.DataFrame | None = None  #: features of the training alarms, with their ``label``
    evidence: Evidence | None = None  #: what explains the alarms, for the viewer
    before: xr.DataArray | None = None  #: run-view before clutter suppression, for the viewer
    #: alarms of every scan's own image, and the pose of each scan by its number, where the recipe scores by frames
    frames: tuple[pd.DataFrame, dict[int, FloatArray]] | None = None


def ranked(
    alarms: pd.DataFrame, features: pd.DataFrame
) -> tuple[pd.DataFrame, pd.DataFrame, NDArray[np.intp]]:
    """Drop alarms without a confidence, sort and name the rest, and keep their features, of the same index, in step."""
    table = alarms[alarms["confidence"].notna()].sort_values(
        "confidence", ascending=False, kind="stable"
    )
    features = features.loc[table.index].reset_index(drop=True)
    rows = table.index.to_numpy()
    table = table.reset_index(drop=True)
    table["alarm_id"] = [f"alarm-{i + 1}" for i in range(len(table))]
    known = [column.name for column in ALARM_COLUMNS if column.name in table.columns]
    return (table[known] if len(table) else empty_table(ALARM_COLUMNS)[known]), features, rows


class CleanedRun:
    """A run's cleaned images, made anew on every pass, as far ahead as counts, and their background.

    ``background`` is the result of the pass "gain"; ``whole`` gives whole images where they are known already.
    """

    def __init__(
        self,
        images: RunImages,
        background: Mapping[str, NDArray[Any]],
        whole: Callable[[int], xr.DataArray] | None = None,
    ) -> None:
        self.grid = images.grid
        self._whole = whole if images.plain else images.image
        self.gains: FloatArray = background["gains"]
        imager = images.imager
        self.whole_background = Background(
            **{name: background[name] for name in background if name != "gains"}
        )
        self.background: Background = self.whole_background.cropped(self.grid.ny)
        self.imager = ScanImager(
            imager.run, self.grid, imager.subbands, imager.window, imager.tolerance, imager.device
        )

    def __len__(self) -> int:
        return len(self.imager)

    def scan(self, index: int, data: ComplexArray | None = None) -> xr.DataArray:
        """Image of the scan at an index among the complete ones, with its ``pose`` and number; ``data`` if at hand."""
        if self._whole is not None:
            return self._whole(index).isel(y=slice(self.grid.ny))
        return self.imager.image(int(self.imager.scans[index]), data)

    def coherent(self, index: int) -> xr.DataArray:
        """Give the cleaned image of the scan at an index, in units of its background, with its phase."""
        image = self.scan(index)
        return image.copy(data=self.background.own_coherent(image.values, self.gains[index]))


class LaneChain(Chain):
    """The passes of a recipe over one run.

    The recipe must fit the run and have a model if it learns, whose detector scores the alarms, by default their local
    contrast does. Results by pass are kept and looked up in ``known``. With a ``section`` only those rows of the lane's
    run-view are worked on: backgrounds are those of the whole run, and run-view, alarms and features those that the
    whole lane has there. ``others`` are runs taken together with it, by the names that the recipe gives them; ``truth``
    are the targets of a training lane, for the first stage that has not learnt yet. With ``explains`` what explains the
    alarms to the viewer is gathered, too; with ``whole`` the background reaches as far as the images, by default as far
    ahead as counts and as that depends on.
    """

    def __init__(
        self,
        run: xr.Dataset,
        recipe: Recipe,
        lane: Lane,
        model: Model | Detector | None = None,
        known: MutableMapping[str, Any] | None = None,
        section: Section | None = None,
        others: Mapping[str, xr.Dataset] | None = None,
        truth: pd.DataFrame | None = None,
        explains: bool = True,
        whole: bool = False,
    ) -> None:
        self._explains = explains
        self.run = run
        self.recipe = recipe
        self.lane = lane
        self.model = as_model(model)
        known = {} if known is None else known
        table = recipe.image
        names = recipe.named()
        self.untrained = unlearnt(recipe, self.model, training=truth is not None)
        self.images = RunImages(
            as_imaged(run, recipe), recipe, lane, self.model, known, others or {}
        )
        self.imager = self.images.imager
        self.setup = self.images.setup
        (median, _), (mean, _), _ = recipe.smoothing
        reach = self.imager.grid.ny if whole else self.images.grid.ny + median // 2 + mean // 2
        self._reach = min(
            reach, self.imager.grid.ny
        )  # rows of the images that the background is estimated on
        made = {
            name: make_stage(name, stage, self.setup, self.model.stages.get(name))
            for name, stage in names.items()
            if not name.startswith("clutter.")
        }
        self.mapper = next((stage for stage in made.values() if isinstance(stage, MapStage)), None)
        self._screener = next(
            (stage for stage in made.values() if isinstance(stage, ScreenStage)), None
        )
        self._columns = {
            name: stage for name, stage in made.items() if isinstance(stage, FeatureStage)
        }
        labels = [str(label) for label in self.imager.run["polarization"].values]
        stages = {name: one for name, one in self._columns.items() if one.columns}
        self._reads = AlarmFeatures(recipe, labels, list(table.subbands), self.images.grid, stages)
        self.variations = variations_of(recipe)
        super().__init__(self._passes(made, truth), len(self.imager), known)
        self.grid = self.setup.view
        if not self.untrained:
            check_confidence(recipe, self._column_names())
        self.section = Section(0, self.grid.ny) if section is None else section
        self._kept = kept_rows(recipe, lane, self.section)
        channels = (
            len(self.setup.imaged) * len(table.subbands) * self.imager.grid.nx * self.imager.grid.ny
        )
        # Variants go through the images again and again, and an aperture's is dear: those of a
        # short run are kept.
        again = len(self.variations) > 1 or len(self.imager) == 1
        self._remembers = again and 8 * len(self.imager) * channels <= CACHE
        self._images: dict[tuple[int, bool], xr.DataArray] = {}
        self._cleaned: dict[str, CleanedRun] = {}
        # Stages may keep what they need again from scan to scan.
        self.concurrent = self.images.plain and not made and len(self.variations) == 1

    def _passes(self, made: Mapping[str, Stage], truth: pd.DataFrame | None) -> list[Pass]:
        """List the passes, up to the one that the first stage that has not learnt yet learns from."""
        passes = self.images.passes()
        learner = self.untrained[0] if self.untrained else ""
        targets = pd.DataFrame({"x": [], "y": []}) if truth is None else truth
        if learner in self.images.stages:
            stage = self.images.stages[learner]
            return [
                *passes,
                Pass(
                    f"learn.{learner}", f"examples for {learner}", lambda _: stage.examples(targets)
                ),
            ]
        suppresses = any(variation.suppressed for variation in self.variations)
        if suppresses:
            passes.append(
                Pass(
                    "roadside",
                    "bright roadside",
                    lambda _: self.roadside.find(self._image),
                    whole=True,
                )
            )
        for variation in self.variations:
            kinds = (self._signature, self._gain, self._view, self._alarms, self._features)
            for kind, title in zip(kinds, KINDS.values(), strict=True):
                name = variation.of(kind.__name__.removeprefix("_"))
                label = title if variation.name == MAIN else f"{variation.name}: {title}"
                whole = kind in (self._signature, self._gain)
                still = kind == self._alarms
                passes.append(Pass(name, label, partial(kind, variation), whole, still=still))
                if name == "gain" and self.mapper is not None and made.get(learner) is self.mapper:
                    examples = partial(self._map_examples, self.mapper, targets)
                    return [*passes, Pass(f"learn.{learner}", f"examples for {learner}", examples)]
                if name == "view" and learner:
                    return passes
                if name == "alarms" and suppresses:
                    passes.append(Pass("share", "share of the roadside", self._share))
                if name == "view" and self.recipe.score.area == "frames":
                    passes.append(Pass("frames", "alarms of every frame", self._frames, whole=True))
        return passes

    def basis(self, name: str) -> dict[str, Any] | None:
        """Tell what a pass's result hangs on beside run, lane and program; None where only this chain can tell.

        Self-signature, gain, run-view and features of alarms hang on a part of the recipe alone: other recipes may have
        the same part. What a stage has learnt is nobody else's.
        """
        kind = name.partition(".")[0]
        clutter = any(one.of.learns for one in self.recipe.clutter)
        mapped = (
            self.recipe.map is not None
            and self.recipe.map.of.learns
            and kind not in ("signature", "gain")
        )
        read = [
            one
            for one in self.recipe.columns
            if getattr(one.of, "of_image", None) is not FeatureStage.of_image
        ]
        if (
            kind not in KINDS
            or kind == "alarms"
            or clutter
            or mapped
            or any(one.of.learns for one in read)
        ):
            return None
        later = kind in ("view", "features")
        tables = IMAGING | VIEWING if later else IMAGING
        told: dict[str, Any] = {
            "pass": name,
            "recipe": self.recipe.model_dump(mode="json", include=tables),
        }
        told["rows"] = self._reach
        if later:
            told.update(explains=self._explains, kept=[self._kept.start, self._kept.stop])
        if kind == "features":
            alarms = self.raised(next(one for one in self.variations if one.of("features") == name))
            told["features"] = self.recipe.model_dump(mode="json", include={"features"})
            told["columns"] = [one.model_dump(mode="json") for one in read]
            told["alarms"] = sha256(alarms[["x", "y"]].to_numpy(np.float64).tobytes())
        return told

    @cached_property
    def reaching(self) -> list[int]:
        """Numbers of the blocks that reach the section, at least one."""
        windows = [self._rows(block) for block in self.blocks]
        return [number for number, rows in enumerate(windows) if rows.start < rows.stop] or [0]

    @cached_property
    def roadside(self) -> Roadside:
        """What a variant suppresses beside the lane."""
        return Roadside(self.recipe, self.imager, self.lane, self.known)

    @property
    def cleaned(self) -> CleanedRun:
        """The run's cleaned images; needs the pass "gain"."""
        return self._cleaned_by(self.variations[0])

    def _cleaned_by(self, variation: Variation) -> CleanedRun:
        if variation.name not in self._cleaned:
            single = len(self.variations) == 1 and not self._remembers
            whole = None if single else partial(self._image, suppressed=variation.suppressed)
            self._cleaned[variation.name] = CleanedRun(
                self.images, self.known[variation.of("gain")], whole
            )
        return self._cleaned[variation.name]

    def raised(self, variation: Variation | None = None) -> pd.DataFrame:
        """Give the prescreener's alarms of a variation, by default the recipe's own; needs its pass "alarms"."""
        known = self.known[(variation or self.variations[0]).of("alarms")]
        table = array_table(group_of(known, "maximum"))
        threshold = self.section.threshold
        if threshold is None:
            threshold = lane_threshold(self.recipe, self.lane, table, int(known["seen"]))
        return table[table["magnitude"] >= threshold].reset_index(drop=True)

    def ranked_alarms(
        self, variation: Variation | None = None
    ) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Give ranked alarms, those with a confidence, and their features of a variation; needs its pass "features"."""
        return self._ranked(variation or self.variations[0])[:2]

    def _ranked(self, variation: Variation) -> tuple[pd.DataFrame, pd.DataFrame, NDArray[np.intp]]:
        """Give ranked alarms, their features, and their numbers among those that were raised."""
        features = array_table(group_of(self.known[variation.of("features")], "feature"))
        alarms = self.raised(variation)
        more = alarms[[name for name in alarms.columns if name not in ("x", "y", "magnitude")]]
        features = pd.concat([features, more], axis=1)
        alarms["confidence"] = self._reads.confidence(
            features, alarms["magnitude"], self.model.detector
        )
        alarms["scans"] = features["scans"]
        if variation.name == MAIN and "share" in self.passes:
            total = self.known["share"]["total"]
            modelled = self.known["share"]["modelled"]
            features = features.assign(
                roadside=np.sqrt(modelled / np.maximum(total, np.finfo(float).tiny))
            )
        alarms, features, numbers = ranked(alarms, features)
        if "roadside" in features:
            alarms = alarms.assign(roadside=features["roadside"])
        if self.recipe.features is None:
            features = features.assign(magnitude=alarms["magnitude"])
        return alarms, features, numbers

    def detection(self, variation: Variation | None = None) -> Detection:
        """Give alarms, features and run-view of a variation, by default the recipe's own; needs its pass "features"."""
        variation = variation or self.variations[0]
        alarms, features = self.ranked_alarms(variation)
        view = self._own_view(variation.of("view"))
        notes = self._notes(variation)
        frames = self._found_by_frames() if variation.name == MAIN else None
        return Detection(
            variation.name, variation.title, alarms, view, notes, features=features, frames=frames
        )

    def detections(self) -> list[Detection]:
        """Give what every variation found, the recipe's own first, and what explains it; needs all passes."""
        screen = self.recipe.prescreen
        several = []
        for variation in self.variations:
            detection = self.detection(variation)
            sums = self._evidence_sums(variation)
            sums.merge(group_of(self.known[variation.of("features")], "evidence"))
            features = detection.features
            detector = self.model.detector
            explained = in_order(sums.result(), self._ranked(variation)[2])
            if detector is None or features is None:
                shares = pd.DataFrame(
                    {self._reads.single: detection.alarms["confidence"].to_numpy()}
                )
            else:
                shares = detector.contributions(features)
            if (
                explained.adds
                and isinstance(detector, TrainedEstimator)
                and detector.linear_in_magnitude
            ):
                low, high = detector.confidence(pd.DataFrame({"magnitude": [0.0, 1.0]}))
                shares = caused(explained, high - low, detection.alarms["confidence"])
            before = self._before() if variation.name == MAIN else None
            channel = screen.polarization, screen.subband
            several.append(
                replace(
                    detection,
                    channel=channel,
                    contributions=shares,
                    evidence=explained,
                    before=before,
                )
            )
        return several

    def _notes(self, variation: Variation) -> dict[str, Any]:
        notes: dict[str, Any] = {}
        detector = self.model.detector
        if self.recipe.features is not None or detector is not None:
            notes["confidence"] = (
                self._reads.single if detector is None else " + ".join(detector.features)
            )
        if "share" in self.passes and (variation.name == MAIN or variation.suppressed):
            notes |= self.roadside.notes()
        for stage in self.images.stages.values():
            notes |= stage.notes()
        return notes

    def _image(self, index: int, suppressed: bool, rows: int | None = None) -> xr.DataArray:
        """Image of the scan at an index among the complete ones, at least ``rows``; without the roadside if wanted."""
        if (index, suppressed) in self._images:
            return self._images[index, suppressed]
        scan = int(self.imager.scans[index])
        data = self.roadside.cleaned(scan) if suppressed else None
        image = self.images.image(index, data, None if self._remembers else rows)
        if self._remembers:
            self._images[index, suppressed] = image
        return image

    def _share(self, block: range | None) -> Accumulator:  # noqa: ARG002
        return self.roadside.share(self.raised(), self._image)

    def _signature(self, variation: Variation, block: range | None) -> Accumulator:  # noqa: ARG002
        tool = self._estimator(variation)
        return Accumulator(
            lambda index: tool.add_signature(self._image(index, variation.suppressed).values),
            tool.first_sums,
            tool.take_first,
            tool.first_result,
        )

    def _map_examples(
        self,
        mapper: MapStage,
        truth: pd.DataFrame,
        block: range | None,  # noqa: ARG002
    ) -> Accumulator:
        return mapper.examples(truth, self.cleaned.coherent)

    def _gain(self, variation: Variation, block: range | None) -> Accumulator:
        tool = self._estimator(variation)
        first = self.known[variation.of("signature")]
        how = self.recipe.background.gain
        if how == "none":
            return Accumulator(
                lambda _: None, lambda _: {}, lambda _: None, lambda: self._level(first, np.ones(1))
            )
        if how == "rows":
            return self._rows_gain(variation, first)
        tool.continue_from(first, slice(None) if block is None else slice(block.start, block.stop))
        return Accumulator(
            lambda index: tool.add_gain(
                self._image(index, variation.suppressed, self._reach).values
            ),
            lambda _: tool.second_sums(),
            tool.take_second,
            lambda: {"gains": first["gains"]} | vars(tool.result()),
        )

    def _rows_gain(self, variation: Variation, first: Mapping[str, NDArray[Any]]) -> Accumulator:
        """Take the median magnitude of every row near the middle, mean over the scans."""
        near = np.abs(self.imager.grid.x) <= (self.recipe.background.within or np.inf)
        sums = {"total": np.zeros((*first["signature"].shape[:3], 1)), "count": np.zeros(1)}

        def add(index: int) -> None:
            image = self._image(index, variation.suppressed, self._reach).values[
                ..., : self._reach, :
            ]
            level = np.abs(image / first["gains"][index][..., None, None] - first["signature"])[
                ..., near
            ]
            sums["total"] += np.median(level, axis=-1, keepdims=True)
            sums["count"] += 1

        return added(
            sums, add, lambda: self._level(first, sums["total"] / np.maximum(sums["count"], 1))
        )

    def _level(self, first: Mapping[str, NDArray[Any]], level: FloatArray) -> Arrays:
        """Give the result of the pass "gain" for a level that is broadcast over the image."""
        gain = np.broadcast_to(level, first["signature"].shape).astype(np.float32)
        if not (gain > 0).all():
            raise ValueError(
                "gain background must be positive everywhere, got zero: the images equal their signature"
            )
        shared = shared_level(gain, first["gains"])
        background = Background(first["signature"], gain, first["shared"], shared)
        return {"gains": first["gains"]} | vars(background)

    def _estimator(self, variation: Variation) -> BackgroundEstimator:
        return BackgroundEstimator(*self.recipe.smoothing, variation.signature, self._reach)

    def _view(self, variation: Variation, block: range | None) -> Accumulator:
        sums = look_sums(self.recipe.run_view, self.grid, self._rows(block))
        cleaned = self._cleaned_by(variation)
        before = self._view_sums(block) if self._explains and variation.name == MAIN else None

        def add(index: int) -> None:
            image = cleaned.scan(index)
            magnitude = self._magnitude(cleaned, image, index)
            sums.add(magnitude, cleaned.grid, np.asarray(image.attrs["pose"]))
            if before is not None:
                before.add(np.abs(image.values), cleaned.grid, np.asarray(image.attrs["pose"]))

        def state() -> Arrays:
            groups = {"look": sums.state()}
            return bundled(groups if before is None else groups | {"before": before.state()})

        def merge(state: Mapping[str, NDArray[Any]]) -> None:
            sums.merge(group_of(state, "look"))
            if before is not None:
                before.merge(group_of(state, "before"))

        def result() -> Arrays:
            values, looks = sums.result()
            values = values.reshape(
                len(values), -1, *values.shape[-2:]
            )  # ranges stand beside the sub-bands
            earlier: Arrays = {}
            if before is not None:
                earlier["view"], earlier["looks"] = before.result()
            view: Arrays = {"view": values, "looks": looks}
            return view | bundled({"before": earlier})

        return Accumulator(add, lambda _: state(), merge, result)

    def _magnitude(
        self, cleaned: CleanedRun, image: xr.DataArray, index: int
    ) -> NDArray[np.float32]:
        """Magnitude (polarization, subband, y, x) of a cleaned image in units of its background, or the map of it."""
        if self.mapper is None:
            return cleaned.background.magnitude(image.values, cleaned.gains[index])
        coherent = cleaned.background.own_coherent(image.values, cleaned.gains[index])
        return self.mapper.map(image.copy(data=coherent))[None, None]

    def _frames(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Raise alarms on every scan's own image (Fuse et al. 2018, Sec. 4), once as many are summed as shall be."""
        cleaned = self._cleaned_by(self.variations[0])
        screen = self.recipe.prescreen
        labels = self._labels()
        channel = (
            labels["polarization"].index(screen.polarization),
            labels["subband"].index(screen.subband),
        )
        parts: list[Arrays] = []

        def add(index: int) -> None:
            if index + 1 < self.images.frames:
                return
            image = cleaned.scan(index)
            level = self._magnitude(cleaned, image, index)[channel]
            alarms = frame_alarms(level, cleaned.grid, self.recipe.frame_area(), screen.radius)
            pose = np.asarray(image.attrs["pose"], dtype=np.float64)
            frame: Arrays = {
                "frame": np.array([index]),
                "pose": pose[None],
                "count": np.array([len(alarms)]),
            }
            parts.append(frame | table_arrays(alarms[["x", "y", "magnitude"]]))

        return gathered(parts, add)

    def _found_by_frames(self) -> tuple[pd.DataFrame, dict[int, FloatArray]] | None:
        """Give the alarms of every frame, and their poses, where they were asked for."""
        if "frames" not in self.passes:
            return None
        known = self.known["frames"]
        names = {"x": "across", "y": "ahead", "magnitude": "confidence"}
        alarms = {
            "frame": np.repeat(known["frame"], known["count"]),
            **{names[one]: known[one] for one in names},
        }
        return pd.DataFrame(alarms), dict(zip(known["frame"].tolist(), known["pose"], strict=True))

    def _alarms(self, variation: Variation, block: range | None) -> Accumulator:  # noqa: ARG002
        """Gather no scans: its result is what may become alarms, and how many pixels of the channel were seen."""

        def result() -> Arrays:
            known = self.known[variation.of("view")]
            screen = self.recipe.prescreen
            view = self._as_view(known["view"], known["looks"], self._kept)
            chosen = select(view, screen.polarization, screen.subband)
            seen = np.count_nonzero(np.isfinite(chosen.values[self._own]))
            return bundled({"maximum": table_arrays(self._raise(view, chosen))}) | {
                "seen": np.array(seen)
            }

        return added({}, lambda _: None, result)

    def _raise(self, view: xr.DataArray, chosen: xr.DataArray) -> pd.DataFrame:
        """Give what may become alarms in the section's own rows, with the features that the run-view has of it."""
        maxima = (
            local_maxima(chosen, self.recipe.prescreen.radius)
            if self._screener is None
            else self._screener.alarms(view).select_dtypes("number")
        )
        # what lies between two rows belongs to the nearer
        y = self.grid.y[self.section.rows]
        half = self.grid.dy / 2
        own = maxima[(maxima["y"] >= y[0] - half) & (maxima["y"] < y[-1] + half)].reset_index(
            drop=True
        )
        for stage in self._columns.values():
            own = own.assign(**stage.of_view(view, own[["x", "y"]].to_numpy(dtype=np.float64)))
        return own

    def _column_names(self) -> list[str]:
        """Name the columns of all feature stages; those of the run-view tell theirs where there is no alarm."""
        channels = self._labels()
        rows = min(2, self.grid.ny)
        shape = *map(len, channels.values()), rows, self.grid.nx
        looks = np.zeros(shape[-2:], np.int64)
        empty = view_array(
            np.full(shape, np.nan, np.float32), looks, self.grid, channels, slice(rows)
        )
        stages = self._columns.values()
        return [
            name for one in stages for name in (*one.columns, *one.of_view(empty, np.zeros((0, 2))))
        ]

    @property
    def training_view(self) -> xr.DataArray:
        """Run-view of the whole lane, for stages that learn from it; needs the pass "view"."""
        return self._own_view("view")

    def _features(self, variation: Variation, block: range | None) -> Accumulator:
        cleaned = self._cleaned_by(variation)
        alarms = self.raised(variation)
        near = np.arange(len(alarms)) if block is None else self._alarms_near(alarms, block)
        sums = AlarmSums(self._reads, alarms.iloc[near], near)
        evidence = None
        if self._explains:
            evidence = self._evidence_sums(
                variation, None if block is None else self._poses_near(block)
            )
        read_once = evidence is not None and self.imager.run is self.setup.run

        def add(index: int) -> None:
            data = self.imager.signal(int(self.imager.scans[index])) if read_once else None
            image = cleaned.scan(index, data)
            gain = cleaned.gains[index]
            where = int(image.attrs["scan"]), np.asarray(image.attrs["pose"])
            scan = self._reads.clean(
                *where, image.values, gain, cleaned.background, own=evidence is not None
            )
            sums.add(scan)
            if evidence is not None:
                evidence.add(self._reads.labelled(scan), data)

        def state(_: bool) -> Arrays:
            return sums.state() | (
                {} if evidence is None else bundled({"evidence": evidence.state()})
            )

        def merge(state: Mapping[str, NDArray[Any]]) -> None:
            sums.merge(state)
            if evidence is not None:
                evidence.merge(group_of(state, "evidence"))

        def result() -> Arrays:
            groups = {"feature": table_arrays(sums.table())}
            return bundled(groups if evidence is None else groups | {"evidence": evidence.state()})

        return Accumulator(add, state, merge, result)

    def _alarms_near(self, alarms: pd.DataFrame, block: range) -> NDArray[np.intp]:
        """Numbers of the alarms that a scan of the block may see."""
        poses = self.setup.run["pose"].values[self.imager.scans[block.start : block.stop]]
        x_min, x_max, _, y_max = self.cleaned.grid.extent()
        farthest = np.hypot(max(abs(x_min), abs(x_max)), y_max)
        y = alarms["y"].to_numpy(dtype=np.float64)
        return np.flatnonzero(
            (y >= poses[:, 1].min() - farthest) & (y <= poses[:, 1].max() + farthest)
        )

    def _evidence_sums(
        self, variation: Variation, poses: Mapping[int, FloatArray] | None = None
    ) -> EvidenceSums:
        contrast = self.recipe.contrast
        alarms = self.raised(variation).iloc[:MOST_GATHERED]
        return EvidenceSums(
            alarms, contrast.patch(), self.recipe.run_view.y_max, self.setup.run, contrast.subband, poses,
            None if self.mapper is None or self.recipe.run_view.look != "mean" else self.mapper.parts,
            self.recipe.run_view.falloff,
        )  # fmt: skip

    def _poses_near(self, block: range) -> dict[int, FloatArray]:
        """Give the poses of all scans that may see what a scan of the block sees."""
        scans = self.imager.scans
        every = self.setup.run["pose"].values
        farthest = float(np.abs(self.cleaned.grid.extent()).max()) * np.sqrt(2)
        y = every[scans[block.start : block.stop], 1]
        near = (every[scans, 1] >= y.min() - 2 * farthest) & (
            every[scans, 1] <= y.max() + 2 * farthest
        )
        return {int(scan): every[scan] for scan in scans[near]}

    def _rows(self, block: range | None) -> slice:
        """Tell which of the kept rows of the lane a block reaches."""
        if block is None:
            return self._kept
        sums = RunViewSums(self.grid, self.recipe.run_view.y_max, slice(0, 0))
        grid = self.imager.grid
        rows = [sums.reach(grid, self.setup.pose(index)) for index in block]
        begin = max(min(row.start for row in rows), self._kept.start)
        return slice(begin, max(min(max(row.stop for row in rows), self._kept.stop), begin))

    def _view_sums(self, block: range | None) -> RunViewSums:
        return RunViewSums(self.grid, self.recipe.run_view.y_max, self._rows(block))

    @property
    def _own(self) -> slice:
        """The section's own rows among those that are kept."""
        return slice(self.section.start - self._kept.start, self.section.stop - self._kept.start)

    def _own_view(self, name: str) -> xr.DataArray:
        return self._of_section(self.known[name])

    def _before(self) -> xr.DataArray:
        """Second largest magnitude of the images before they were cleaned, for the viewer."""
        return self._of_section(group_of(self.known["view"], "before"), plain=True)

    def _of_section(self, known: Mapping[str, NDArray[Any]], plain: bool = False) -> xr.DataArray:
        """Give the section's own rows of a run-view."""
        return self._as_view(
            known["view"][..., self._own, :], known["looks"][self._own], self.section.rows, plain
        )

    def _as_view(
        self,
        values: NDArray[np.float32],
        looks: NDArray[np.int64],
        rows: slice,
        plain: bool = False,
    ) -> xr.DataArray:
        return view_array(values, looks, self.grid, self._labels(plain), rows)

    def _labels(self, plain: bool = False) -> dict[str, list[str]]:
        """Name the channels of the run-view or, plain, those of the images."""
        polarization = [str(label) for label in self.imager.run["polarization"].values]
        subband = list(self.recipe.image.subbands)
        if not plain:
            subband = self.recipe.view_channels
            polarization = polarization if self.recipe.map is None else [self.recipe.map.stage]
        return {"polarization": polarization, "subband": subband}


def table_arrays(table: pd.DataFrame) -> Arrays:
    """Take a table of numbers apart into one array per column."""
    return {str(name): table[name].to_numpy() for name in table.columns}


def array_table(arrays: Mapping[str, NDArray[Any]]) -> pd.DataFrame:
    """Put a table together again."""
    return pd.DataFrame({name: arrays[name] for name in arrays})
