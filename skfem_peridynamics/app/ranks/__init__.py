"""Runs of scenes over several processes."""
