# The command `orchard` in a container; compose.yaml has an example with two machines. Not tested yet:
# the machines on which the project is tested run no Docker daemon.
FROM python:3.11-slim

WORKDIR /source
COPY . .
RUN pip install --no-cache-dir --constraint constraints.txt '.[secure]'

# Compiled kernels are kept in the image, so that a container starts at once on a machine of the kind that built it.
ENV ORCHARD_RUNS=/runs NUMBA_CACHE_DIR=/kernels
RUN useradd orchard && mkdir /runs /kernels && chown orchard /runs /kernels
USER orchard
WORKDIR /runs
RUN orchard --mode local --rows 3 --duration 1 --record none && rm -r /runs/*

VOLUME /runs
EXPOSE 7447
ENTRYPOINT ["orchard"]
