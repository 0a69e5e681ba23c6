# docker build -t bumpstop . && docker run --rm bumpstop            evaluates the first example
# docker run --rm -v "$PWD:/cell" bumpstop evaluate my_cell.toml    evaluates a file of the current folder
FROM python:3.11-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends build-essential && rm -rf /var/lib/apt/lists/*
COPY . /source
# The kernels of all instruction sets: the image may run on another processor than the one it was made on.
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels \
    --config-settings=cmake.define.BUMPSTOP_INSTRUCTION_SETS=all /source

FROM python:3.11-slim-bookworm
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir /wheels/bumpstop-*.whl && rm -r /wheels
COPY examples /examples
RUN useradd --create-home bumpstop && mkdir /cell && chown bumpstop /cell
USER bumpstop
WORKDIR /cell
ENTRYPOINT ["bumpstop"]
CMD ["evaluate", "/examples/01_hand_downward.toml"]
