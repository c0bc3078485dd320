"""Finds how a model uses a picture (the doctor, 28 calls), and its request mode (the probe)."""

from eyechart.probe.doctor import Diagnosis, doctor
from eyechart.probe.mode_probe import ProbeError, ProbeResult, probe
from eyechart.probe.sample import Sample, default_sample, is_served

__all__ = [
    "Diagnosis",
    "ProbeError",
    "ProbeResult",
    "Sample",
    "default_sample",
    "doctor",
    "is_served",
    "probe",
]
