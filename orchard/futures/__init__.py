"""What comes of a run from one of its moments on: forks, futures, and the moment that decides."""
