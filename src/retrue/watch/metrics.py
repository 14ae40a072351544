"""Metrics of a watch for Prometheus, counted from its events; needs `pip install ".[watch]"`."""

from __future__ import annotations

from types import TracebackType
from typing import Any, TypeVar, cast

from retrue.errors import InputError
from retrue.watch.events import Event

T = TypeVar("T")


class Metrics:
    """Counts events, by rig; serves /metrics on a port of this machine while the block lasts."""

    def __init__(self, port: int = 0, address: str = "127.0.0.1") -> None:
        try:
            from prometheus_client import CollectorRegistry, Counter, Gauge, Summary
        except ImportError as error:
            raise InputError("metrics: expected prometheus_client, found none; pip install '.[watch]'") from error
        self._port, self._address = port, address
        self._registry = registry = CollectorRegistry()

        def made(kind: type[T], name: str, what: str, *labels: str) -> T:
            return cast("Any", kind)(f"retrue_{name}", what, ["rig", *labels], registry=registry)

        self._frames = made(Counter, "frames", "Frames by what became of them", "verdict")
        self._dropped = made(Counter, "dropped_frames", "Frames that came too fast")
        self._answers = made(Counter, "recalibrations", "Recalibrations by answer", "answer")
        self._seconds = made(Summary, "stage_seconds", "Seconds that a stage took", "stage")
        self._residual = made(Gauge, "epipolar_rms_px", "Epipolar RMS under the rig in place")
        self._rotation = made(Gauge, "drift_rotation_deg", "Drift of the rotation")
        self._translation = made(Gauge, "drift_translation_deg", "Drift of the direction of t")
        self._sigmas = made(Gauge, "drift_sigmas", "Drift in standard deviations")
        self._creep = made(Gauge, "creep_sigmas", "Creep in standard deviations of the filter")
        self._temperature = made(Gauge, "temperature", "Last reading beside the rig")

    def text(self) -> bytes:
        """What Prometheus reads."""
        from prometheus_client import generate_latest

        return generate_latest(self._registry)

    def __enter__(self) -> Metrics:
        from prometheus_client import start_http_server

        try:
            self._server, self._thread = start_http_server(self._port, self._address, self._registry)
        except (OSError, OverflowError) as error:
            raise InputError(f"metrics: port {self._port} cannot be served: {error}") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    @property
    def port(self) -> int:
        """The one that is served, also where any free one (0) was asked for."""
        return self._server.server_port

    def observe(self, event: Event, rig: str = "") -> None:
        """Count one event of a rig."""
        match event["event"]:
            case "frame":
                self._frames.labels(rig, event["verdict"]).inc()
                self._drift(event, rig)
            case "bad frame":
                self._frames.labels(rig, "bad").inc()
            case "dropped":
                self._dropped.labels(rig).inc(event["count"])
            case "recalibrated" | "refused":
                self._answers.labels(rig, event["event"]).inc()
            case _:
                return
        for stage, seconds in event.get("seconds", {}).items():
            self._seconds.labels(rig, stage).observe(seconds)

    def _drift(self, event: Event, rig: str) -> None:
        drift: dict[str, float] = event["drift"] or {}
        creep: dict[str, float] = event.get("creep") or {}
        for gauge, value in (
            (self._residual, event["epipolar_rms_px"]),
            (self._rotation, drift.get("rotation_deg")),
            (self._translation, drift.get("translation_deg")),
            (self._sigmas, event["drift_sigmas"]),
            (self._creep, creep.get("sigmas")),
            (self._temperature, event.get("temperature")),
        ):
            if value is not None:
                gauge.labels(rig).set(value)
