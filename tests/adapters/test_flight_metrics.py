"""What monitoring reads of a live flight, from the messages of one."""

import json
import sys
from dataclasses import asdict

import pytest
from prometheus_client.parser import text_string_to_metric_families

from deckline.adapters.metrics import flight_metrics
from deckline.adapters.metrics.flight_metrics import FlightMetrics
from deckline.live.messages import FrameCounts


def message(status, age_s, **counts):
    """A live message; without an age, one without a frame."""
    live = {"age_s": age_s, **asdict(FrameCounts(**counts))}
    return {"status": status, "file": None if age_s is None else "a.png", "live": live}


def figures(response):
    """Values by sample and labels."""
    families = text_string_to_metric_families(bytes(response.body).decode())
    return {(sample.name, *sample.labels.values()): sample.value for family in families for sample in family.samples}


@pytest.fixture
def flown():
    metrics = FlightMetrics()
    metrics.update(message("unverified", 0.04, frames=3))
    metrics.update(message("ok", 0.12, frames=7, dropped=1, damaged=2, unsent=1))
    metrics.update(message("stale", None, frames=7, dropped=1, damaged=2, unsent=1))
    metrics.update(message("ok", 0.06, frames=9, dropped=1, damaged=2, unsent=1, restarts=1))
    return metrics


def test_counters_are_those_of_the_last_message(flown):
    found = figures(flown.get_metrics())
    totals = {"frames": 9, "frames_dropped": 1, "frames_damaged": 2, "answers_unsent": 1, "source_restarts": 1}
    assert {name: found[f"deckline_{name}_total",] for name in totals} == totals
    assert found["process_start_time_seconds",] > 0


def test_messages_are_counted_by_status_and_answers_by_age(flown):
    found = figures(flown.get_metrics())
    counted = {name: found["deckline_messages_total", name] for name in ("ok", "unverified", "stale", "not seen")}
    assert counted == {"ok": 2, "unverified": 1, "stale": 1, "not seen": 0}
    below = {bound: found["deckline_answer_age_seconds_bucket", bound] for bound in ("0.03", "0.05", "0.1", "+Inf")}
    assert below == {"0.03": 0, "0.05": 1, "0.1": 2, "+Inf": 3}  # the message without a frame has no age
    assert found["deckline_answer_age_seconds_sum",] == pytest.approx(0.22)


def test_health_is_that_of_the_last_message_and_ends_with_silence(flown, monkeypatch):
    healthy = flown.get_health()
    assert healthy.status_code == 200
    assert {"status": "ok", "age_s": 0.06}.items() <= json.loads(healthy.body).items()
    monkeypatch.setattr(flight_metrics, "SILENT_S", 0.0)
    assert flown.get_health().status_code == 503


def test_without_the_extra_the_answer_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    metrics = FlightMetrics()
    metrics.update(message("ok", 0.04))
    response = metrics.get_metrics()
    assert response.status_code == 501 and b'pip install "deckline[metrics]"' in response.body
    assert metrics.get_health().status_code == 200
