"""Compiled kernels.

Decorators, intrinsics, exact functions, random numbers, work queue and thread pool.
"""
