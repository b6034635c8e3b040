# The same commands as on any other machine, inside a container; docker-compose.yml gives it its volume and privileges.
FROM python:3.11-slim-bookworm

RUN apt-get update \
    && apt-get install --yes --no-install-recommends make \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --user-group sinew \
    && install --directory --owner sinew --group sinew /sinew /data

USER sinew
WORKDIR /sinew
COPY --chown=sinew:sinew . .
RUN make install frontend EXTRAS=postgres

VOLUME /data
EXPOSE 8000
# Only the container's own network sees this address; docker-compose.yml publishes it on the host's loopback.
CMD ["make", "run", "ARGS=--host 0.0.0.0 --data /data"]
