# docker build --target core --tag deckline .          # what flies: no torch, no GPU
# docker build --target flight --tag deckline:flight . # for the aircraft: MAVLink, OpenVINO, dashboard, bags; no torch
# docker build --target full --tag deckline:full .     # simulator, training, dashboard, logs, tests
# docker run --rm --volume "$PWD:/data" --user "$(id -u)" deckline run RECORDING --out results
# docker run --init --volume "$PWD:/data" --network host --device /dev/video0 deckline:flight live camera:0 --dashboard
FROM python:3.11-slim-bookworm AS wheel
WORKDIR /src
COPY requirements.lock ./
RUN pip install --no-cache-dir --no-deps --require-hashes --requirement requirements.lock
COPY pyproject.toml MANIFEST.in LICENSE PYPI.md ./
COPY src src
RUN pip wheel --no-cache-dir --no-deps --no-build-isolation --wheel-dir /wheels .

FROM python:3.11-slim-bookworm AS core
ENV PYTHONUTF8=1 ORT_DISABLE_TELEMETRY=1 HOME=/tmp
COPY requirements.lock /locks/
RUN pip install --no-cache-dir --no-deps --require-hashes --requirement /locks/requirements.lock
COPY --from=wheel /wheels /wheels
RUN pip install --no-cache-dir --no-deps /wheels/*.whl && useradd --uid 1000 deckline
USER 1000
WORKDIR /data
ENTRYPOINT ["deckline"]
CMD ["--help"]

FROM core AS flight
USER 0
COPY requirements-flight.lock /locks/
RUN pip install --no-cache-dir --no-deps --require-hashes --requirement /locks/requirements-flight.lock
USER 1000

FROM core AS full
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
USER 0
# EGL on the processor, for the simulator. Debian keeps no old versions that could be pinned.
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install --yes --no-install-recommends libegl1 libgl1-mesa-dri libegl-mesa0 \
 && rm -rf /var/lib/apt/lists/*
COPY requirements-dev.lock /locks/
RUN pip install --no-cache-dir --index-url "$TORCH_INDEX" torch==2.13.0 \
 && pip install --no-cache-dir --no-deps --require-hashes --requirement /locks/requirements-dev.lock
USER 1000
