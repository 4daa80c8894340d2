# The program and its Python package on Debian 12: docker build -t raysfm .
#   docker run --rm -v "$PWD:/data" raysfm track video.mp4 --camera camera.yaml --out out/
FROM debian:bookworm AS build
# What bundles the page of results.
RUN apt-get update && apt-get install --yes --no-install-recommends npm
COPY . /raysfm
WORKDIR /raysfm
RUN scripts/package

FROM debian:bookworm-slim
COPY --from=build /raysfm/build-package/raysfm_*.deb /raysfm/build-package/python3-raysfm_*.deb /packages/
RUN apt-get update \
    && apt-get install --yes --no-install-recommends /packages/*.deb \
    && rm -rf /packages /var/lib/apt/lists/*
WORKDIR /data
ENTRYPOINT ["raysfm"]
