# An image that runs the workflow; results appear in the folder that is mounted at /work:
#   docker build -t expertaug .
#   docker run --rm -v "$PWD:/work" expertaug --cores 2 --configfile config/smoke.yaml
FROM python:3.11-slim
WORKDIR /opt/expertaug
# The CPU build of torch in a layer of its own: it is most of the image, and seldom changes.
RUN pip install --no-cache-dir uv && uv pip install --system --no-cache --torch-backend=cpu torch==2.13.0
COPY pyproject.toml setup.py constraints.txt README.md LICENSE Snakefile ./
COPY src src
COPY workflow workflow
COPY config config
COPY profiles profiles
COPY results/published results/published
RUN pip install --no-cache-dir -c constraints.txt .
WORKDIR /work
ENTRYPOINT ["expertaug", "run"]
