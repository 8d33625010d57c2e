"""`/healthz` and Prometheus `/metrics` of a live flight, for the dashboard's server."""

import time

from fastapi import FastAPI
from starlette.responses import JSONResponse, Response

from deckline.extras import needs_extra
from deckline.live.pipeline import STALE_EVERY_S
from deckline.report.records import Record
from deckline.types import Status

SILENT_S = 4 * STALE_EVERY_S  # without a message: even without frames one goes out every STALE_EVERY_S
AGES_S = (0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0)  # upper bounds of the histogram's buckets
UNHEALTHY, NOT_INSTALLED = 503, 501  # HTTP
COUNTS = {  # of the record's `live` -> counter, help
    "frames": ("deckline_frames", "Frames that came whole."),
    "dropped": ("deckline_frames_dropped", "Frames that a newer one replaced before they were processed."),
    "damaged": ("deckline_frames_damaged", "Frames that could not be used."),
    "unsent": ("deckline_answers_unsent", "Answers that a newer one replaced because the output is slow."),
    "restarts": ("deckline_source_restarts", "Times that the source came back after a failure."),
}


class FlightMetrics:
    """Health and figures of a live flight; one thread calls `update`, any thread asks."""

    def __init__(self) -> None:
        self._newest: tuple[Record, float] = {}, time.monotonic()  # the last message, and when it was sent
        self._figures: Figures | None = None
        self._missing = ""
        try:
            self._figures = Figures()
        except ImportError as error:
            self._missing = str(error)

    def update(self, record: Record) -> None:
        """Count a message."""
        self._newest = record, time.monotonic()
        if self._figures is not None:
            self._figures.update(record)

    def add_routes(self, app: FastAPI) -> None:
        app.get("/healthz")(self.get_health)
        app.get("/metrics")(self.get_metrics)

    def get_health(self) -> Response:
        """Status and age of the last message; 200 while messages go out, those of status `stale` included, else 503."""
        record, sent_s = self._newest
        silent_s = time.monotonic() - sent_s
        body = {"status": record.get("status"), "age_s": record.get("live", {}).get("age_s")}
        return JSONResponse(body | {"silent_s": round(silent_s, 3)}, 200 if silent_s < SILENT_S else UNHEALTHY)

    def get_metrics(self) -> Response:
        """The text that Prometheus reads; 501 and one line where the extra is not installed."""
        if self._figures is None:
            return Response(f"{self._missing}\n", NOT_INSTALLED, media_type="text/plain")
        return Response(*self._figures.text())


class Figures:
    """Prometheus counters of a flight's messages and of this process.

    Raises:
        ImportError: the extra `metrics` is not installed.
    """

    def __init__(self) -> None:
        with needs_extra("metrics"):
            import prometheus_client as prometheus
        self._registry = prometheus.CollectorRegistry()
        self._generate, self._media_type = prometheus.generate_latest, prometheus.CONTENT_TYPE_LATEST
        registry = self._registry
        self._counts = {field: prometheus.Counter(*named, registry=registry) for field, named in COUNTS.items()}
        self._counted = dict.fromkeys(COUNTS, 0)
        self._messages = prometheus.Counter("deckline_messages", "Messages by status.", ["status"], registry=registry)
        for status in Status:
            self._messages.labels(status)  # begins at 0
        text = "From capture to sending."
        self._ages = prometheus.Histogram("deckline_answer_age_seconds", text, buckets=AGES_S, registry=registry)
        prometheus.ProcessCollector(registry=registry)  # process_start_time_seconds shows a restart

    def update(self, record: Record) -> None:
        """Count a message; those of frames have an age."""
        live = record["live"]
        self._messages.labels(record["status"]).inc()
        for field, counter in self._counts.items():
            counter.inc(live[field] - self._counted[field])
            self._counted[field] = live[field]
        if record["file"] is not None:
            self._ages.observe(live["age_s"])

    def text(self) -> tuple[bytes, int, dict[str, str]]:
        """Body, HTTP status and headers of an answer."""
        return self._generate(self._registry), 200, {"Content-Type": self._media_type}
