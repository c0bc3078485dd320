"""What a model does with a picture, and how it is best asked: a doctor in 28 calls, a probe that pins a mode."""

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
