"""What a server tells Prometheus: requests, assessments, votes, seconds, and its own memory and processor time."""

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector

from eyechart.guardian import Assessment
from eyechart.studies.guardian import VIEWS

_BUCKETS = (0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


class Metrics:
    """What Prometheus is told."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self.requests = Counter("eyechart_requests", "Requests by status.", ("status",), registry=self.registry)
        self.answers = Counter("eyechart_assessments", "Assessments by answer.", ("answer",), registry=self.registry)
        self.votes = Counter("eyechart_votes", "Votes.", ("model", "view", "vote"), registry=self.registry)
        self.seconds = Histogram(
            "eyechart_assessment_seconds",
            "From a request's head to its assessment.",
            buckets=_BUCKETS,
            registry=self.registry,
        )
        self.waiting = Gauge("eyechart_waiting", "Pictures that wait or are asked about.", registry=self.registry)

    def note(self, assessment: Assessment) -> None:
        """Count an assessment and its votes."""
        self.answers.labels(assessment.answer).inc()
        words = {True: "hazard", False: "clear", None: "missing"}
        for model, pair in assessment.votes.items():
            for view, vote in zip(VIEWS, pair, strict=True):
                self.votes.labels(model, view, words[vote]).inc()
