"""The task.

Gentle cutting, its rewards, its ends and its observation.
"""
