"""The behaviours of robots, people and animals, the steps and routes that they are made of, and the evaluation of scans."""
