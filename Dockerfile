# Two stages: the first builds the page and a wheel with node and npm, the second holds Python, the installed wheel and
# nothing else. docker-compose.yml gives it its volume, limits and rights.
FROM python:3.11-slim-bookworm AS build

WORKDIR /source
COPY . .
# What the locks name, each file as its hash says; then the wheel, that brings nothing along. Its files get a time of
# whole seconds: machine code is stale when its source has another time, and layers keep no parts of a second.
RUN python -m venv /opt/sinew \
    && python -m pip install --no-cache-dir --require-hashes --requirement .ci/locks/build.lock \
    && python -m pip wheel --no-cache-dir --no-build-isolation --no-deps --wheel-dir /wheel . \
    && /opt/sinew/bin/python -m pip install --no-cache-dir --require-hashes \
        --requirement .ci/locks/run.lock --requirement .ci/locks/postgres.lock --requirement .ci/locks/cluster.lock \
    && /opt/sinew/bin/python -m pip install --no-cache-dir --no-deps --no-index "$(ls /wheel/sinew-*.whl)" \
    && find /opt/sinew/lib/python3.11/site-packages/plant /opt/sinew/lib/python3.11/site-packages/backend \
        -name '*.py' -exec touch --date=@1600000000 {} +

FROM python:3.11-slim-bookworm

# Number 1000, as a password file of the host's first user can then be read without opening it to others.
RUN useradd --create-home --uid 1000 --user-group sinew \
    && install --directory --mode 700 --owner sinew --group sinew /data
COPY --from=build /opt/sinew /opt/sinew

# The control laws and what starts compute, once for all containers: a first start with an empty volume copies them.
# `sinew` appends its own folder to this one, as it does to the volume's.
RUN XDG_CACHE_HOME=/opt/compiled /opt/sinew/bin/python -P -m backend.compile_ahead \
    && XDG_CACHE_HOME=/opt/compiled /opt/sinew/bin/python -P -m backend.realtime.compile_ahead \
    && chmod -R a+rX /opt/compiled

USER sinew
WORKDIR /data
# Only the container's own network sees this address; docker-compose.yml publishes it on the host's loopback.
ENV PATH=/opt/sinew/bin:$PATH PYTHONUNBUFFERED=1 SINEW_DATA=/data SINEW_HOST=0.0.0.0 XDG_CACHE_HOME=/data/cache \
    SINEW_CACHE_PREPARED=/opt/compiled/sinew
VOLUME /data
EXPOSE 8000
# On another processor than that of the build a first start compiles the control laws anew; a minute or two.
HEALTHCHECK --interval=10s --timeout=5s --start-period=180s --retries=3 CMD ["python", "-c", \
    "import json, urllib.request as u; raise SystemExit(not json.load(u.build_opener(u.ProxyHandler({})).open('http://127.0.0.1:8000/api/health', timeout=4))['alive'])"]
CMD ["sinew", "serve"]
