"""Gymnasium environments; the only package part that depends on Gymnasium."""
