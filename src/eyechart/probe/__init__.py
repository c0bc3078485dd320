"""Finds how a model uses a picture (the doctor, 28 calls), and its request mode (the probe)."""

from eyechart.probe.doctor import Diagnosis, doctor
from eyechart.probe.pinning import Found, ProbeError, probe
from eyechart.probe.sample import Sample, default_sample, is_served

__all__ = [
    "Diagnosis",
    "Found",
    "ProbeError",
    "Sample",
    "default_sample",
    "doctor",
    "is_served",
    "probe",
]
