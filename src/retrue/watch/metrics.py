"""Metrics of a watch for Prometheus, counted from its events; needs the extra `retrue[watch]`."""

from __future__ import annotations

from types import TracebackType

from retrue.errors import InputError
from retrue.watch.events import Event


class Metrics:
    """Serves /metrics on a port of this machine while the block lasts; `observe` listens to events."""

    def __init__(self, port: int, address: str = "127.0.0.1") -> None:
        try:
            from prometheus_client import CollectorRegistry, Counter, Gauge, Summary
        except ImportError as error:
            raise InputError("metrics: expected prometheus_client, found none; pip install 'retrue[watch]'") from error
        self._port, self._address = port, address
        self._registry = registry = CollectorRegistry()
        self._frames = Counter("retrue_frames", "Frames by what became of them", ["verdict"], registry=registry)
        self._dropped = Counter("retrue_dropped_frames", "Frames that came too fast", registry=registry)
        self._answers = Counter("retrue_recalibrations", "Recalibrations by answer", ["answer"], registry=registry)
        self._seconds = Summary("retrue_stage_seconds", "Seconds that a stage took", ["stage"], registry=registry)
        self._residual = Gauge("retrue_epipolar_rms_px", "Epipolar RMS under the rig in place", registry=registry)
        self._rotation = Gauge("retrue_drift_rotation_deg", "Drift of the rotation", registry=registry)
        self._translation = Gauge("retrue_drift_translation_deg", "Drift of the direction of t", registry=registry)
        self._sigmas = Gauge("retrue_drift_sigmas", "Drift in standard deviations", registry=registry)

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

    def observe(self, event: Event) -> None:
        """Count one event."""
        match event["event"]:
            case "frame":
                self._frames.labels(event["verdict"]).inc()
                self._drift(event)
            case "bad frame":
                self._frames.labels("bad").inc()
            case "dropped":
                self._dropped.inc(event["count"])
            case "recalibrated" | "refused":
                self._answers.labels(event["event"]).inc()
            case _:
                return
        for stage, seconds in event.get("seconds", {}).items():
            self._seconds.labels(stage).observe(seconds)

    def _drift(self, event: Event) -> None:
        if event["epipolar_rms_px"] is not None:
            self._residual.set(event["epipolar_rms_px"])
        if event["drift"] is not None:
            self._rotation.set(event["drift"]["rotation_deg"])
            self._translation.set(event["drift"]["translation_deg"])
        if event["drift_sigmas"] is not None:
            self._sigmas.set(event["drift_sigmas"])
