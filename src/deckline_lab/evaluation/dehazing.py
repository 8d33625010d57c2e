"""`deckline eval dehazing`: dehazers against clear pictures, what they do to the lines, and what they cost."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from deckline import __version__
from deckline.checks import check_numbers
from deckline.config import Models
from deckline.dehaze import NOT_DEHAZED, Dehazer, OnnxDehazer, restore
from deckline.flight import Flight
from deckline.recording import FrameError
from deckline.report.draw import check_picture_name, write_picture
from deckline.report.provenance import settings_of
from deckline_lab.evaluation.blind import check_no_sheets, count_votes, read_votes, vote_tables, write_blind_sheets
from deckline_lab.evaluation.chain import single_frames_with
from deckline_lab.evaluation.dehazers import (
    Cost,
    CostTask,
    build_dehazer,
    by_name,
    measure_costs,
    model_of,
    shown_name,
)
from deckline_lab.evaluation.dehazing_pairs import Pair, PairSource, open_pairs
from deckline_lab.evaluation.dehazing_score import (
    ImageScore,
    lines_are_right,
    restoration,
    score_lines,
    summarise,
    summarise_film,
    visible_figures,
)
from deckline_lab.evaluation.dehazing_tables import DehazingResults, dehazing_tables, json_of
from deckline_lab.evaluation.no_reference import no_reference_figures, visible_range_m
from deckline_lab.evaluation.pictures import sheet
from deckline_lab.evaluation.store import Store
from deckline_lab.evaluation.tables import TO_TERMINAL, Output, made_with, publish
from deckline_lab.rivals.catalog import flight_from_config
from deckline_sim.progress import progress

NO_DETECTOR = "none"
SCORES_FILE = "dehazing.jsonl"


@dataclass(frozen=True)
class DehazingConfig:
    """Compare dehazers on pairs of a hazy and a clear picture, or on hazy pictures alone.

    Visible edges, gradients, saturation and dark channel against the hazy picture, and how many pictures came out worse
    than they went in. With clear pictures every image's PSNR and SSIM, by visibility and, where the truth holds them,
    by rain and motion blur, with the paired difference to a reference. With true lines, how far they are seen, and
    whether the detector finds them better or worse than without dehazing; with --cost time and memory. Images count as
    independent: true for random views, not for the frames of one flight, whose intervals come out too narrow.

    With --out a stopped command resumes, and a command with more dehazers adds theirs.

    --blind writes sheets for people who do not know which panel is which. Into votes.csv they write for each sheet an
    order, A>B or A=B, of more panels B>A=C. --votes counts every votes*.csv beside the key.

    Args:
        sources: recordings with clear pictures (`deckline dataset`, `deckline sim`), or folders of images whose
            labels.json names the clear image of a hazy one as pair_of, with camera.toml and poses.csv beside them; or
            recordings, pictures and videos without clear ones.
        dehazer: names and .onnx files; none, doing nothing, is always measured as well.
        reference: name of the dehazer that the others' PSNR and cost are compared with.
        detector: name or .onnx file; none leaves the lines out.
        every: take every so many of a source's pairs.
        deck_z_m: world z of the deck plane; overrides the sources' value.
        sea_z_m: world z of the water; overrides the sources' value.
        with_depth: give the dehazers the recorded depth, which in a dataset is the truth.
        full_size: networks without a coarse grid work on the whole picture, not on one averaged down.
        cost: measure latency and peak memory as well, each run in a process of its own.
        cost_size: width and height of the picture for that, px.
        cost_runs: of each dehazer, interleaved.
        output: files of the results.
        sheet: write one picture with what every dehazer makes of a few pairs (.png or .jpg).
        sheet_visibility: of those pairs, m: for each the pair that comes nearest.
        out: folder for a row per image and dehazer.
        blind: folder for sheets to judge, with key.json and votes.csv.
        blind_panels: of a sheet; 2 makes pairs.
        blind_seed: of the shuffling.
        votes: count the votes in this folder of --blind, and measure nothing.

    Raises:
        ValueError: neither sources nor votes, or both; a sheet that is no picture; a folder that holds sheets; an
            `every`, `cost_runs` or `cost_size` below 1, or `blind_panels` not in 2..26.
    """

    sources: tyro.conf.Positional[tuple[Path, ...]] = ()
    dehazer: tuple[str, ...] = (NOT_DEHAZED, "dark-channel", "geometry", Models.dehazer)
    reference: str = NOT_DEHAZED
    detector: str = Models.detector
    every: int = 1
    deck_z_m: float | None = None
    sea_z_m: float | None = None
    with_depth: bool = False
    full_size: bool = False
    cost: bool = False
    cost_size: tuple[int, int] = (1280, 720)
    cost_runs: int = 5
    output: Output = TO_TERMINAL
    sheet: Path | None = None
    sheet_visibility: tuple[float, ...] = (400.0, 1000.0, 2500.0)
    out: Path | None = None
    blind: Path | None = None
    blind_panels: int = 2
    blind_seed: int = 0
    votes: Path | None = None

    def __post_init__(self) -> None:
        if bool(self.sources) == (self.votes is not None):
            raise ValueError("give at least one recording or folder of pictures, or --votes alone")
        if self.sheet is not None:
            check_picture_name(self.sheet, "a sheet")
        if self.blind is not None:
            check_no_sheets(self.blind)
        check_numbers(self, "", "every", "cost_runs", "cost_size", least=1)
        check_numbers(self, "", "blind_panels", least=2, most=26)


@dataclass(frozen=True, eq=False)
class DehazingBench:
    """Everything loaded."""

    named: Mapping[str, str]  # name -> as given
    dehazers: Mapping[str, Dehazer]
    flight: Flight | None  # detector and what follows, without a dehazer of its own; None: no lines
    reference: str
    sources: tuple[PairSource, ...]


def dehazing(config: Annotated[DehazingConfig, tyro.conf.arg(name="")]) -> int:
    if config.votes is not None:
        return _publish_votes(config.votes, config.output)
    bench = _load(config)
    store = Store(config.out, SCORES_FILE, _settings(config, bench), extendable="dehazers")
    with store:
        scores, skipped = _score_all(bench, store)
    if not scores:
        raise ValueError(f"zero frames: none of {len(skipped)} could be used; the first: {', '.join(skipped[0])}")
    costs, failed = _costs(config, bench, scores[0]) if config.cost else ({}, {})
    results = DehazingResults(
        title=_title(config, len({score.image for score in scores})),
        reference=bench.reference,
        summaries=summarise(scores, bench.reference),
        film=summarise_film(scores, bench.reference),
        sizes={n: each.cost if isinstance(each, OnnxDehazer) else None for n, each in bench.dehazers.items()},
        costs=costs,
        cost_size_px=config.cost_size,
        failed=failed,
        skipped=tuple(skipped),
        visible=visible_figures(scores) if bench.flight is not None else {},
    )
    figures = json_of(results) | {"about": made_with()}
    notes = [f"skipped {len(skipped)}; the first: {': '.join(skipped[0])}"] if skipped else []
    publish(results.title, dehazing_tables(results), figures, config.output, notes)
    if config.sheet is not None:
        write_picture(config.sheet, sheet(bench.sources, bench.dehazers, scores, config.sheet_visibility))
        print(config.sheet)
    if config.blind is not None:
        rng = np.random.default_rng(config.blind_seed)
        count = write_blind_sheets(config.blind, bench.sources, bench.dehazers, config.blind_panels, rng)
        print(f"{config.blind}: {count} sheets to judge, and votes.csv to fill in")
    return 0


def _publish_votes(folder: Path, output: Output) -> int:
    votes, empty = read_votes(folder)
    counts = count_votes(votes)
    notes = [f"sheets without a vote: {empty}"] if empty else []
    publish(f"{folder}: {len(votes)} votes", vote_tables(counts), counts | {"not_judged": empty}, output, notes)
    return 0


def _load(config: DehazingConfig) -> DehazingBench:
    named = by_name((NOT_DEHAZED, *config.dehazer))
    reference = config.reference if config.reference in named else shown_name(config.reference)
    named = by_name((*named.values(), named.get(reference, config.reference)))
    dehazers = {name: build_dehazer(given, config.full_size) for name, given in named.items()}
    flight = None
    if config.detector != NO_DETECTOR:
        flight = flight_from_config(single_frames_with(NOT_DEHAZED, config.detector))
    heights = config.deck_z_m, config.sea_z_m
    sources = tuple(open_pairs(path, config.every, *heights, config.with_depth) for path in config.sources)
    if not any(source.keys for source in sources):
        raise ValueError(f"zero frames: no picture in {', '.join(map(str, config.sources))}")
    return DehazingBench(named, dehazers, flight, reference, sources)


def _settings(config: DehazingConfig, bench: DehazingBench) -> dict[str, Any]:
    """What decides a row's numbers."""
    chain = {} if bench.flight is None else settings_of(bench.flight)
    return {
        "deckline": __version__,
        "sources": [source.name for source in bench.sources],
        **{name: getattr(config, name) for name in ("every", "deck_z_m", "sea_z_m", "with_depth", "full_size")},
        "detector": chain.get("detector", NO_DETECTOR),
        "localization": chain.get("localization", ""),
        "dehazers": {name: model_of(dehazer) for name, dehazer in bench.dehazers.items()},
    }


def _score_all(bench: DehazingBench, store: Store) -> tuple[list[ImageScore], list[tuple[str, str]]]:
    """All scores, those that the store lacks measured; and the images that cannot be used with the reason."""
    pairs = [(source, key) for source in bench.sources for key in source.keys]
    skipped = []
    with progress("evaluating", len(pairs) * len(bench.dehazers)) as advance:
        for source, key in pairs:
            missing = [name for name in bench.dehazers if (source.name, key, name) not in store.rows]
            try:
                if missing:
                    pair = source.load(key)
                    for name in missing:
                        store.add((source.name, key, name), asdict(_score(bench, source.name, key, name, pair)))
            except FrameError as error:
                skipped.append((f"{source.name}: {error.file}", error.reason))
            for _ in bench.dehazers:
                advance()
    keys = [(source.name, key, name) for name in bench.dehazers for source, key in pairs]
    return [ImageScore(**store.rows[key]) for key in keys if key in store.rows], skipped


def _score(bench: DehazingBench, source: str, key: str, name: str, pair: Pair) -> ImageScore:
    restored = restore(bench.dehazers[name], pair.frame)
    figures = no_reference_figures(restored.image_rgb, pair.frame.image_rgb)
    if pair.in_view:
        figures["visible_range_m"] = visible_range_m(restored.image_rgb, pair.frame.image_rgb, pair.in_view)
    if pair.clear_rgb is not None:
        figures |= restoration(restored.image_rgb, pair.clear_rgb, pair.surface)
    score = ImageScore(source, key, name, pair.visibility_m, figures, restored.note, pair.film)
    score = replace(score, time_s=pair.frame.time_s, range_m=pair.range_m)
    if bench.flight is None or pair.lines is None:
        return score
    result = bench.flight(replace(pair.frame, image_rgb=restored.image_rgb))
    found, distances_px = score_lines(result, pair.lines)
    return replace(score, found=found, distances_px=distances_px, is_right=lines_are_right(result.detection, pair))


def _costs(config: DehazingConfig, bench: DehazingBench, score: ImageScore) -> tuple[dict[str, Cost], dict[str, str]]:
    """Costs on the hazy picture of one score."""
    tasks = {}
    for name, given in bench.named.items():
        absolute = str(Path(given).resolve()) if given.endswith(".onnx") else given
        tasks[name] = CostTask(
            absolute, score.source, score.key, config.cost_size, config.full_size, config.deck_z_m, config.sea_z_m
        )
    with progress("measuring cost", config.cost_runs * len(tasks)) as step:
        return measure_costs(tasks, config.cost_runs, step)


def _title(config: DehazingConfig, images: int) -> str:
    sources = " ".join(map(str, config.sources))
    what = [f"{images} pictures of {sources}", f"detector {config.detector}"]
    what += [f"one of {config.every} taken"] if config.every > 1 else []
    what += ["dehazers given the recorded depth"] if config.with_depth else []
    what += ["full-resolution networks at full size"] if config.full_size else []
    return "; ".join(what)


dehazing.__doc__ = DehazingConfig.__doc__
