"""Checks of scores and of decisions by them: agreement with the task, exploits, pass marks, sequential studies."""
