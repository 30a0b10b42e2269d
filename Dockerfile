# ospc with the versions pinned in requirements/, for images in a mounted folder:
#   docker build -t ospc .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" ospc calibrate my_recording -o my_camera
FROM python:3.12-slim AS build
WORKDIR /src
COPY requirements/user.lock requirements/user.lock
RUN python -m venv /opt/ospc \
    && /opt/ospc/bin/pip install --no-cache-dir --require-hashes --requirement requirements/user.lock
COPY pyproject.toml README.md LICENSE ./
COPY src src
RUN /opt/ospc/bin/pip install --no-cache-dir --no-deps --no-build-isolation .

FROM python:3.12-slim
COPY --from=build /opt/ospc /opt/ospc
ENV PATH="/opt/ospc/bin:$PATH" MPLCONFIGDIR=/tmp/matplotlib
RUN useradd --create-home --uid 1000 ospc
USER 1000
WORKDIR /data
ENTRYPOINT ["ospc"]
CMD ["--help"]
