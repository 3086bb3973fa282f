# Image with hhsim alone, run by a user without rights; results go to the folder that is mounted at /data:
#   docker build -t hhsim .
#   docker run --rm -v "$PWD:/data" --user "$(id -u)" hhsim replay bunny grasp
FROM python:3.12-slim AS wheel
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.12-slim
COPY constraints.txt /tmp/constraints.txt
COPY --from=wheel /wheels /wheels
RUN pip install --no-cache-dir -c /tmp/constraints.txt /wheels/*.whl \
    && rm -r /wheels /tmp/constraints.txt \
    && useradd --uid 1000 --create-home hhsim
# Compiled kernels are kept where any --user may write, each in a folder of its own.
ENV HOME=/tmp
USER 1000
WORKDIR /data
ENTRYPOINT ["hhsim"]
CMD ["--help"]
