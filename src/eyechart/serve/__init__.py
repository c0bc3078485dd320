"""A guardian over HTTP: one picture a request, an answer by the deadline, and a refusal rather than a long queue.

It listens on this machine only unless told otherwise, answers to its own names only, has no password, and keeps no
picture. The page of a run that goes on (``live``) needs nothing of the guardian, so this file imports nothing.
"""
