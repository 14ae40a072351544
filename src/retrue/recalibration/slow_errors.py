"""What a slow error does to a pose that took it up: the residuals show only what the fit left of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.two_view import PARAMETERS, POSE_PARAMETERS, normal_blocks
from retrue.recalibration.parameters import LENSES
from retrue.recalibration.posterior import Posterior

WAVES = 3  # along each side: half waves 0, 1 and 2
LENGTHS = (0.25, 0.75)  # over which it changes, of the picture's extent
AMPLITUDES = np.geomspace(0.005, 0.2, 10)  # px
NONE = 0.5  # of captures, before their points speak


@dataclass(frozen=True, slots=True, eq=False)
class TakenUp:
    """What slow errors of M kinds did to a pose.

    Attributes
    ----------
    weights : (M,) how likely each is; they sum to 1.
    covariances : (M, 5, 5) what the covariance of the pose lacks then.
    """

    weights: FloatArray
    covariances: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """(5, 5) what it lacks on average."""
        return np.tensordot(self.weights, self.covariances, 1)


def taken_up(answer: Posterior) -> TakenUp:
    """What slow errors may have done to its pose, by the evidence of each kind; each capture has its own.

    Across the epipolar lines an error may run smoothly over the picture, f = sum a_k cos(i pi u) cos(j pi v), with
    a ~ N(0, s^2 Q) and Q = exp(-3/4 length^2 (i^2 + j^2)). Beside the unknowns x, of information A with their priors,
    it has the restricted likelihood of length and s (Patterson and Thompson 1971)

        G = F^T W F - C^T A^-1 C,    g = F^T W r - C^T A^-1 J^T W r,    C = J^T W F
        log p = (g^T D (1 + D G D)^-1 D g - log |1 + D G D|) / 2,       D = s Q^(1/2)

    in the noise that neighbours are seen to share. As the pose takes up M a, M = A^-1 C, it lacks M E[a a^T] M^T. Of
    several captures the kinds of each are told, the others' being what they are on average.
    """
    captures = answer.measured.capture
    each = [_of_capture(answer, np.flatnonzero(captures == index)) for index in np.unique(captures)]
    average = np.sum([one.covariance for one in each], axis=0)
    return TakenUp(
        np.concatenate([one.weights for one in each]) / len(each),
        np.concatenate([one.covariances + (average - one.covariance) for one in each]),
    )


def _of_capture(answer: Posterior, rows: IntArray) -> TakenUp:
    """The same of an error of those points alone."""
    cross, squares, left = _equations(answer, rows)
    follows = np.linalg.solve(answer.information, cross)
    weights, variances = _variances(squares - cross.T @ follows, left - follows.T @ answer.gradient)
    own = answer.own_and_lens[0]  # lenses that are not free take up nothing
    pose = follows[:POSE_PARAMETERS] if answer.prior.free else answer.own_inverse @ cross[own]
    return TakenUp(weights, (pose * variances[:, None, :]) @ pose.T)


def _fields(pixels: FloatArray, out: FloatArray) -> None:
    """`out` (K, N) <- the cosines, of RMS 1; (u, v) run over what is seen, to 1 along its longer side."""
    place = np.subtract(pixels.T, pixels.min(axis=0)[:, None], order="C")
    cosine = np.cos(place * (np.pi / max(float(place.max()), 1e-300)))
    waves = [np.ones(cosine.shape), cosine]
    while len(waves) < WAVES:  # cos(k a) = 2 cos(a) cos((k - 1) a) - cos((k - 2) a)
        waves.append(2 * cosine * waves[-1] - waves[-2])
    of_rms_1 = np.stack([waves[0], *(wave * np.sqrt(2) for wave in waves[1:])])
    np.multiply(of_rms_1[:, None, 0], of_rms_1[None, :, 1], out=out.reshape(WAVES, WAVES, -1))


def _equations(answer: Posterior, rows: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """C (S, K), F^T W F (K, K) and F^T W r (K,); across its line no point knows its plane, nor how that is bowed."""
    fit, count = answer.fit, WAVES**2
    columns = np.empty((count + 1, 1, len(rows)))
    _fields(answer.measured.camera_px[rows], columns[:count])
    columns[count] = fit.found.epipolar[rows]
    shapes, bows = answer.measured.bowed(answer.parameters.bows)
    camera, projector = answer.turns
    points, turns = answer.points.select(rows), (camera[rows], projector[rows])
    weights = np.take(fit.weights, rows, axis=1)
    blocks = normal_blocks(answer.pose, points, weights, columns, turns, (shapes[rows], bows))[-1]
    last = PARAMETERS + count
    found, lenses = slice(PARAMETERS, last), slice(last + 1, last + 1 + LENSES)
    cross = np.zeros((len(answer.gradient), count))
    cross[:POSE_PARAMETERS] = blocks[found, :POSE_PARAMETERS].T
    cross[answer.own_and_lens[1]] = blocks[lenses, found]
    lower = np.tril(blocks[found, found])
    return cross, lower + np.tril(lower, -1).T, blocks[last, found]


def _variances(unseen: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(M,) the share of each length and s in the evidence, and (M, K) variances of the amplitudes; G and g."""
    squares = (np.arange(WAVES)[:, None] ** 2 + np.arange(WAVES) ** 2).ravel()
    spectra = np.exp(-0.75 * np.square(LENGTHS)[:, None] * squares)
    spectra /= spectra.sum(axis=1, keepdims=True)
    amplitudes = np.append(0.0, AMPLITUDES)
    before = np.append(NONE, np.full(len(AMPLITUDES), (1 - NONE) / len(AMPLITUDES)))
    variances: FloatArray = np.square(amplitudes)[:, None, None] * spectra
    root: FloatArray = np.sqrt(variances)
    spread: FloatArray = np.eye(len(squares)) + root[..., :, None] * unseen * root[..., None, :]
    asked: FloatArray = root * left
    solved = np.linalg.solve(spread, asked[..., None])
    volume: FloatArray = np.asarray(np.linalg.slogdet(spread)[1], dtype=np.float64)
    log_evidence: FloatArray = ((asked * solved[..., 0]).sum(axis=-1) - volume) / 2
    weights = before[:, None] * np.exp(log_evidence - log_evidence.max())
    return weights.ravel() / weights.sum(), variances.reshape(weights.size, -1)
