# The demo and the tests, from the lock files:
#   docker build -t stadera .
#   docker run --rm -v "$PWD/out:/stadera/out" stadera          # the demo, out/demo.html
#   docker run --rm stadera make test
FROM python:3.11-slim
RUN apt-get update && apt-get install -y --no-install-recommends git make && rm -rf /var/lib/apt/lists/*
WORKDIR /stadera
COPY Makefile pyproject.toml README.md LICENSE ./
COPY requirements requirements
COPY src src
RUN make .venv/.development
COPY . .
CMD ["make", "demo"]
