"""Slow and obvious answers that the models are held against."""
