"""Sequences of pictures to correspondences: each axis is read by its sines, else by its Gray code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Card, Correspondences
from retrue.decoding.gray.decode_gray_code import REASONS as GRAY_REASONS
from retrue.decoding.gray.decode_gray_code import band_rows, read_gray
from retrue.decoding.gray.faults import CAPTURE, changing_pixels, require_complements
from retrue.decoding.gray.sequence import gray_sequence
from retrue.decoding.light import FULL, filling_their_scale, saturated
from retrue.decoding.sequence.arrange import (
    ArrangedSequence,
    arrange,
    frames_of,
    lights_of,
    pair_starts,
    require_all_numbers,
    scene_lights,
    taken_without_lights,
)
from retrue.decoding.sequence.exposure import require_white_or_black
from retrue.decoding.sequence.read_sines import FEWEST_TURNS, plan_sines, read_sines
from retrue.decoding.sequence.read_sines import REASONS as SINE_REASONS
from retrue.decoding.sequence.sine_faults import ON_ITS_HEAD, SineFault, find_sine_fault
from retrue.errors import CaptureError
from retrue.geometry.arrays import FloatArray, Image
from retrue.kernels import pixels as kernel
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.sequence import FrameSequence

MIRRORED = "the projector's picture is mirrored, or the camera's (rear projection, a driver, a mirror?): switch it off"
FEWEST_TO_TELL_SIDES, MOST_TO_TELL_SIDES = 100, 20_000
FIRST_PX = 1.0  # which ends at 0.5, and a margin for noise
LEAST_SINE = 0.1
"""Of the angle between the two axes of the projector, as the camera sees them."""
MOST_OVEREXPOSED = 0.3
"""Of the lit pixels: with more, overexposure may be why a capture does not decode."""
HARDLY_ANY = 0.05
"""Of the pixels whose brightness changes: of less that decodes, noise that was told from wrong pictures may be why."""
LEAST_LIT = 0.01
"""Of the picture: of less, noise is why nothing decodes, since light was seen."""
REASONS = {**GRAY_REASONS, **SINE_REASONS}


def decode_sequence(
    pattern: GrayCode | FrameSequence, images: Sequence[Image], names: Sequence[str] | None = None
) -> Correspondences:
    """One correspondence per camera pixel whose code can be trusted, projector coordinates to sub-pixel.

    Parameters
    ----------
    pattern : what the projector showed.
    images : of the frames, in order; of a Gray code white and black last, first or left out. (height, width) or
        (height, width, 3), red green blue, uint8 or uint16.
    names : of the pictures, for messages.

    Returns
    -------
    Correspondences
        of one projector coordinate only where the sequence shows one axis.

    Raises
    ------
    CaptureError
        a picture is missing, doubled, late, swapped or of another size, nothing is lit, or the codes exceed
        the projector; names the picture.
    """
    return decode_pictures(pattern, images, names or [f"picture {k + 1}" for k in range(len(images))])[0]


def decode_pictures(
    pattern: GrayCode | FrameSequence, images: Sequence[Image], names: Sequence[str]
) -> tuple[Correspondences, ArrangedSequence]:
    """The same, with the pictures as they were understood.

    Pictures that do not decode are asked what happened to them. Where they can be read all the same they are, and the
    card says so; else the error says what happened, and first that they are overexposed, where that may be why.
    """
    require_all_numbers(pattern, names)
    images = filling_their_scale(images)
    taken = taken_without_lights(pattern, len(images))
    try:
        points, sequence = _decode_or_diagnose(pattern, images, names)
        if taken and points.card is not None and points.card.details.get("mirrored"):
            raise CaptureError(CAPTURE, MIRRORED)  # white, taken for the first bit, turns all others round
        return points, sequence
    except CaptureError as error:
        from retrue.decoding.sequence.diagnosis import overexposed

        if taken:
            error = CaptureError(CAPTURE, f"{taken}; read so, {error.problem}")
        if frames_of(pattern, len(images)) is None or not (share := overexposed(images)) > MOST_OVEREXPOSED:
            raise error from None
        too_bright = f"{100 * share:.0f} % of the lit pixels are overexposed: shorten the exposure"
        raise CaptureError(CAPTURE, f"{too_bright}; read as they are, {error.problem}") from error


def _decode_or_diagnose(
    pattern: GrayCode | FrameSequence, images: Sequence[Image], names: Sequence[str]
) -> tuple[Correspondences, ArrangedSequence]:
    try:
        sequence = arrange(pattern, images, names)
        if (fault := find_sine_fault(sequence.spec, sequence.pictures, sequence.names)) is not None:
            return _read_all_the_same(sequence, fault)
        if isinstance(pattern, FrameSequence) and (pairs := pair_starts(sequence.spec.frames)):
            require_complements(sequence.pictures, sequence.names, pairs, lights_of(sequence.spec.frames))
        require_white_or_black(sequence.spec.frames, sequence.pictures)
        points = decode_arranged(sequence)
    except CaptureError as error:
        if len({image.shape[:2] for image in images}) != 1 or len({image.dtype for image in images}) != 1:
            raise
        return _diagnosed(pattern, images, names, error)
    if len(points) < HARDLY_ANY * changing_pixels(sequence.pictures):
        doubt = CaptureError(CAPTURE, "hardly any lit pixel decodes")
        try:
            return _diagnosed(pattern, images, names, doubt)
        except CaptureError as told:
            from retrue.decoding.sequence.diagnosis import shows_another_code

            if told is not doubt or shows_another_code(pattern, images):
                raise
    return points, sequence


def _diagnosed(
    pattern: GrayCode | FrameSequence, images: Sequence[Image], names: Sequence[str], error: CaptureError
) -> tuple[Correspondences, ArrangedSequence]:
    """As what they are; raises `error`, why they are not what was expected, where nothing tells more."""
    from retrue.decoding.sequence.diagnosis import diagnose, require_like_pictures

    frames = frames_of(pattern, len(images)) or ()
    if not any(frame.code == "gray" for frame in frames):
        raise error
    found = diagnose(pattern, images, names)
    if found is None:
        require_like_pictures(frames, pattern.projector_size, images, names)  # which tells the picture
        raise error
    what = "; ".join(found.causes)
    if found.sequence is None:
        raise CaptureError(CAPTURE, what) from error
    try:
        points = decode_arranged(found.sequence)
    except CaptureError as still:
        if not {"gain_spread", "share_of_picture_before"} & set(found.figures):
            raise error from None  # another order that does not decode explains nothing
        raise CaptureError(CAPTURE, f"{what}; read so, {still.problem}") from error
    return _told(points, found.causes, found.figures), found.sequence


def _told(points: Correspondences, causes: Sequence[str], figures: Mapping[str, float]) -> Correspondences:
    """The same, with what happened in its card."""
    card = points.card
    assert card is not None
    advice = (f"read all the same: {'; '.join(causes)}", *card.advice)
    return replace(
        points,
        card=replace(card, advice=advice, details={**card.details, "read_all_the_same": list(causes), **figures}),
    )


def _read_all_the_same(sequence: ArrangedSequence, fault: SineFault) -> tuple[Correspondences, ArrangedSequence]:
    """In the order, without the gains and the share of the picture before, that were found; raises where it cannot."""
    if fault.spec is None:
        raise CaptureError(CAPTURE, "; ".join(fault.causes))
    pictures = sequence.pictures
    if fault.share or fault.gains is not None:
        from retrue.decoding.sequence.diagnosis import without_light_faults

        gains = np.ones(len(pictures)) if fault.gains is None else fault.gains
        pictures = without_light_faults(pictures, gains, fault.share)
        for seen, made in zip(sequence.pictures, pictures, strict=True):
            made[seen >= FULL * np.iinfo(seen.dtype).max] = np.iinfo(made.dtype).max
    white, black, _ = scene_lights(fault.spec, pictures, pictures)
    sequence = replace(sequence, spec=fault.spec, pictures=pictures, white=white, black=black)
    points = decode_arranged(sequence)
    points = _without_ends(points) if ON_ITS_HEAD in fault.causes else points
    return _told(points, fault.causes, fault.figures), sequence


def _without_ends(points: Correspondences) -> Correspondences:
    """Without the projector's first column and row, where alone it matters which it is: pixel n of a picture on its
    head shows at side - 1 - n, of shifts that run the other way at side - n, of the first pixel a turn less."""
    x, y = points.projector_px.T
    kept = (x > FIRST_PX) & (y > FIRST_PX)
    card, lost = points.card, int(np.count_nonzero(~kept))
    assert card is not None
    rejected = {**card.rejected, "beyond": card.rejected["beyond"] + lost}
    coverage = card.coverage * (1 - lost / len(points))
    card = replace(card, decoded=card.decoded - lost, rejected=rejected, coverage=coverage)
    return replace(points.select(kept), card=card)


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What one way of reading found in a band of rows.

    Attributes
    ----------
    pixels : (N,) flat index into the band, ascending.
    projector_px : by axis, (N,).
    sigma_px : (N,) of either coordinate, root mean square.
    sigma_ratio : (N,) of x over y, or None where they are alike, or one is unknown.
    light : (N,) what the projector adds, or None.
    seen : lit pixels; rejected : those that are no points, by reason.
    """

    pixels: NDArray[np.intp]
    projector_px: Mapping[int, FloatArray]
    sigma_px: FloatArray
    sigma_ratio: FloatArray | None
    light: FloatArray | None
    seen: int
    rejected: Mapping[str, int]


def decode_arranged(sequence: ArrangedSequence) -> Correspondences:
    """The same, of pictures that are arranged already."""
    sine_axes = [axis for axis in sequence.spec.axes if sequence.spec.sines(axis)]
    gray_axes = [axis for axis in sequence.spec.axes if axis not in sine_axes]
    rows = band_rows(sequence.white.shape[0])
    details: dict[str, object] = {}
    read: list[list[Points]] = []
    with ThreadPoolExecutor(2) as threads:
        if gray_axes:
            found = read_gray(gray_sequence(sequence, gray_axes), threads, thorough=sequence.thorough)
            read.append(
                [
                    Points(
                        own.found.pixels,
                        own.found.projector_px,
                        own.found.sigma_px,
                        own.found.sigma_ratio,
                        None,
                        own.seen,
                        own.rejected,
                    )
                    for own in found
                ]
            )
            depths = np.sum([band.depths for band in found], axis=0).tolist()
            if len(depths) > 1:
                details["points_by_bits_left_out"] = depths
        if sine_axes:
            noise, plans = plan_sines(sequence, sine_axes, threads)
            details |= {"noise_floor": noise.floor, "noise_gain": noise.gain}
            sines = read_sines(sequence, noise, plans, rows, threads)
            read.append(
                [Points(b.pixels, b.projector_px, b.sigma_px, None, b.light, b.seen, b.rejected) for b in sines]
            )
        bands = read[0] if len(read) == 1 else [_both(*pair) for pair in zip(*read, strict=True)]
        return _assemble(sequence, bands, rows, details, threads)


def _both(gray: Points, sines: Points) -> Points:
    """The pixels that both ways of reading took, one axis each."""
    pixels, a, b = np.intersect1d(gray.pixels, sines.pixels, assume_unique=True, return_indices=True)
    px = {axis: own[a] for axis, own in gray.projector_px.items()}
    px |= {axis: own[b] for axis, own in sines.projector_px.items()}
    sigma = np.sqrt((gray.sigma_px[a] ** 2 + sines.sigma_px[b] ** 2) / 2)
    ratio = gray.sigma_px[a] / sines.sigma_px[b]
    ratio = ratio if 0 in gray.projector_px else 1 / ratio
    lost = {"undecided": max(gray.seen, sines.seen) - len(pixels)}
    return Points(
        pixels, px, sigma, ratio, None if sines.light is None else sines.light[b], max(gray.seen, sines.seen), lost
    )


def _assemble(
    sequence: ArrangedSequence,
    bands: Sequence[Points],
    rows: Sequence[range],
    details: Mapping[str, object],
    threads: ThreadPoolExecutor,
) -> Correspondences:
    ends = np.cumsum([len(band.pixels) for band in bands])
    total = int(ends[-1])
    height, width = sequence.white.shape
    camera_px, projector_px, sigma_px = np.empty((total, 2)), np.empty((total, 2)), np.empty(total)
    cells, colors = np.empty((total, 2), np.int64), np.empty((total, 3), np.uint8)
    light = np.empty(total)
    ratio = np.empty(total) if all(band.sigma_ratio is not None for band in bands) else None

    colors_seen = sequence.color.reshape(height * width, *sequence.color.shape[2:])
    white, black = sequence.white.reshape(-1), sequence.black.reshape(-1)

    def fill(band: Points, rows: range, end: int) -> None:
        part = slice(end - len(band.pixels), end)
        flat = np.empty_like(band.pixels)
        kernel.places(band.pixels, width, rows.start, flat, cells[part], camera_px[part])
        for axis in range(2):
            projector_px[part, axis] = band.projector_px.get(axis, np.nan)
        sigma_px[part] = band.sigma_px
        if ratio is not None:
            ratio[part] = band.sigma_ratio
        seen = np.take(colors_seen, flat, axis=0)
        if band.light is None:
            np.subtract(np.take(white, flat), np.take(black, flat), out=light[part], dtype=np.float64)
            light[part][saturated(seen)] = np.nan
        else:
            light[part] = band.light
        seen = seen >> 8 if seen.dtype == np.uint16 else seen
        colors[part] = seen[:, None] if seen.ndim == 1 else seen

    list(threads.map(fill, bands, rows, ends.tolist()))
    for array in (camera_px, projector_px, sigma_px, ratio, light, cells, colors):
        if array is not None:
            array.setflags(write=False)
    return Correspondences(
        camera_px,
        projector_px,
        projector_sigma_px=sigma_px,
        projector_sigma_ratio=ratio,
        colors=colors,
        cells=cells,
        card=_card(sequence, total, bands, details, is_mirrored(camera_px, projector_px)),
        light=light,
        camera_size=(width, height),
        projector_size=sequence.spec.projector_size,
    )


def _card(
    sequence: ArrangedSequence, points: int, bands: Sequence[Points], details: Mapping[str, object], mirrored: bool
) -> Card:
    """Raises `CaptureError` where nothing was decoded."""
    lit, pixels = sum(band.seen for band in bands), sequence.white.size
    rejected = {reason: sum(band.rejected[reason] for band in bands) for reason in bands[0].rejected}
    if points == 0:
        reason = max(rejected, key=lambda name: rejected[name])
        if not lit > LEAST_LIT * pixels:
            raise CaptureError(
                CAPTURE,
                f"nothing decodes: {lit} of {pixels} pixels are lit beyond their noise: expose longer, or brighten the "
                "projector",
            )
        what = f"{rejected[reason]} of {lit} lit pixels: {REASONS[reason]}"
        raise CaptureError(CAPTURE, f"nothing decodes: {what}; do the pictures show this pattern?")
    return Card(
        "pixels",
        seen=lit,
        decoded=points,
        rejected=rejected,
        coverage=points / pixels,
        advice=(*([MIRRORED] if mirrored else []), *_advice(sequence, lit, rejected)),
        details={"pixels": pixels, **({"mirrored": True} if mirrored else {}), **details},
    )


def is_mirrored(camera_px: FloatArray, projector_px: FloatArray) -> bool:
    """Whether the projector's picture is seen as a mirror shows it: its axes turn the other way than the camera's.

    However camera and projector are turned, what both see of a surface's one side turns the same way. By the sign of
    the determinant of the affine map between them that fits best.
    """
    if len(camera_px) < FEWEST_TO_TELL_SIDES or np.isnan(projector_px[0]).any():
        return False
    every = max(len(camera_px) // MOST_TO_TELL_SIDES, 1)
    camera, projector = camera_px[::every], projector_px[::every]
    design = np.column_stack([camera - camera.mean(axis=0), np.ones(len(camera))])
    found = np.asarray(np.linalg.lstsq(design, projector, rcond=None)[0], np.float64)
    (a, b), (c, d) = found[:2].tolist()
    return a * d - b * c < -LEAST_SINE * float(np.hypot(a, b) * np.hypot(c, d))


def _advice(sequence: ArrangedSequence, lit: int, rejected: Mapping[str, int]) -> list[str]:
    advice: list[str] = []
    pixels = sequence.white.size
    if lit < 0.2 * pixels:
        advice.append(f"the projector lights {100 * lit / pixels:.0f} % of the picture: turn it towards the scene")
    if rejected.get("undecided", 0) > 0.5 * lit:
        advice.append("most pixels do not resolve the finest stripes: focus, expose longer, or use a larger step")
    if rejected.get("alone", 0) > 0.5 * lit:
        advice.append("stripe edges are sparse: noise or texture hides them; expose longer")
    if any(_gamma_is_hidden(sequence.spec, axis) for axis in sequence.spec.axes):
        advice.append(
            "one sine of three shifts cannot tell the projector's gamma, which may move points by several per cent of "
            "its period, beside their sigma: set it to linear, or add a finer sine"
        )
    full = float(np.mean(saturated(sequence.white[::4, ::4].ravel())))
    if full > 0.05:
        advice.append(f"{100 * full:.0f} % of the white picture is overexposed: shorten the exposure")
    return advice


def _gamma_is_hidden(spec: FrameSequence, axis: int) -> bool:
    """Whether an axis is told by one broad sine of three shifts alone: gamma bends its phases as a surface would."""
    sines = spec.sines(axis)
    return (
        spec.gray(axis) is None
        and len(sines) == 1
        and len(sines[0].pictures) == 3
        and sines[0].period_px * FEWEST_TURNS > spec.projector_size[axis]
    )
