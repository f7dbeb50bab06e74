"""Compiled kernels: decorators, intrinsics, exact functions, random numbers, work queue and thread pool."""
