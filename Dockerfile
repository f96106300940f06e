# The program on Debian 12, with the packages that the Makefile lists. What was tried: docs/platforms.md.
#   docker build -t fenics-contact .
#   docker run --rm -v "$PWD:/work" fenics-contact solve demos/03_wall_w3.toml -o out
FROM debian:12-slim
RUN apt-get update && apt-get install -y --no-install-recommends make && rm -rf /var/lib/apt/lists/*
COPY . /opt/fenics_contact
RUN cd /opt/fenics_contact && make setup && rm -rf /var/lib/apt/lists/*
# Forms are compiled into the cache, whoever runs the container.
ENV PATH=/opt/fenics_contact/.venv/bin:$PATH \
    OMP_NUM_THREADS=1 \
    XDG_CACHE_HOME=/tmp/cache \
    OMPI_ALLOW_RUN_AS_ROOT=1 \
    OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
WORKDIR /work
ENTRYPOINT ["fenics-contact"]
