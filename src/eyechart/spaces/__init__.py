"""The space of actions: reading replies, distances between actions, and reflection.

No other package knows what an action is.
"""
