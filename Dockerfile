# flgpr with what a Dask cluster, maps and blind tests need: docker build -t flgpr:0.1 .
FROM python:3.12-slim

# Compiled kernels are kept in the image, where every user finds them.
ENV NUMBA_CACHE_DIR=/opt/flgpr-kernels PIP_NO_CACHE_DIR=1 PYTHONDONTWRITEBYTECODE=1

WORKDIR /opt/flgpr
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY src ./src
RUN pip install --disable-pip-version-check -c constraints.txt '.[cluster,gis,seal]'
RUN mkdir -p "$NUMBA_CACHE_DIR" && python -m flgpr.kernels.ahead && chmod -R a+rwX "$NUMBA_CACHE_DIR"

RUN useradd --create-home radar
USER radar
WORKDIR /home/radar
ENTRYPOINT ["flgpr"]
CMD ["--help"]
