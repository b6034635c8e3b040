# Two stages: the first builds the page and a wheel with node and npm, the second contains only Python and the installed
# wheel. docker-compose.yml sets volume, limits and capabilities.
FROM python:3.11-slim-bookworm AS build

WORKDIR /source
COPY . .
# Installs the locked packages with verified hashes, then the wheel without dependencies. Its files get a modification
# time in whole seconds: compiled code is stale if the time of its source differs, and layers drop fractions of a second.
RUN python -m venv /opt/sinew \
    && python -m pip install --no-cache-dir --require-hashes --requirement .ci/locks/build.lock \
    && python -m pip wheel --no-cache-dir --no-build-isolation --no-deps --wheel-dir /wheel . \
    && /opt/sinew/bin/python -m pip install --no-cache-dir --require-hashes \
        --requirement .ci/locks/run.lock --requirement .ci/locks/postgres.lock --requirement .ci/locks/cluster.lock \
    && /opt/sinew/bin/python -m pip install --no-cache-dir --no-deps --no-index "$(ls /wheel/sinew-*.whl)" \
    && find /opt/sinew/lib/python3.11/site-packages/plant /opt/sinew/lib/python3.11/site-packages/backend \
        -name '*.py' -exec touch --date=@1600000000 {} +

FROM python:3.11-slim-bookworm

# User id 1000, the first user of the host, so that a password file of that user is readable with mode 600.
RUN useradd --create-home --uid 1000 --user-group sinew \
    && install --directory --mode 700 --owner sinew --group sinew /data
COPY --from=build /opt/sinew /opt/sinew

# Compile the control laws and the code of the start once for all containers: a first start with an empty volume copies
# the result. `sinew` appends the name of its subfolder to this path, as it does to that of the volume.
RUN XDG_CACHE_HOME=/opt/compiled /opt/sinew/bin/python -P -m backend.compile_ahead \
    && XDG_CACHE_HOME=/opt/compiled /opt/sinew/bin/python -P -m backend.realtime.compile_ahead \
    && chmod -R a+rX /opt/compiled

USER sinew
WORKDIR /data
# Only the network of the container can reach this address; docker-compose.yml publishes it on the loopback of the host.
ENV PATH=/opt/sinew/bin:$PATH PYTHONUNBUFFERED=1 SINEW_DATA=/data SINEW_HOST=0.0.0.0 XDG_CACHE_HOME=/data/cache \
    SINEW_CACHE_PREPARED=/opt/compiled/sinew
VOLUME /data
EXPOSE 8000
# If the processor differs from that of the build, the first start compiles the control laws again: one or two minutes.
HEALTHCHECK --interval=10s --timeout=5s --start-period=180s --retries=3 CMD ["python", "-c", \
    "import json, urllib.request as u; raise SystemExit(not json.load(u.build_opener(u.ProxyHandler({})).open('http://127.0.0.1:8000/api/health', timeout=4))['alive'])"]
CMD ["sinew", "serve"]
