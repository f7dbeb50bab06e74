"""Checks of a class's server under load and attack, and of its page in browsers."""
