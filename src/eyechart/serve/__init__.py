"""A guardian over HTTP: one picture a request, an answer by its deadline, no long queue.

By default it listens only on this machine. It answers only to its own names, has no password, and
keeps no picture. This file imports nothing: the page of a current run (``live``) needs no guardian.
"""
