"""The benchmark of dispatch policies: its orchards, what a policy sees there, and its scores.

An instance is one of its orchards, in a file. A split is a set of instances: `train` and `test` are
public, and a secret draws the hidden one. A submission is a file with the scores of a policy and
all its decisions, which others can replay. docs/benchmark.md explains all of it to users.
"""
