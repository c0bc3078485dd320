"""Simulated policies with known answers: the errors of the rules, and what a bank can decide."""
