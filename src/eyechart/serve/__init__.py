"""A guardian over HTTP: one picture a request, answered by the deadline or refused with 503.

By default it listens only on this machine. It answers only to its own names, has no password, and
keeps no picture. This file imports nothing: the page of a current run (``live``) needs no guardian.
"""
