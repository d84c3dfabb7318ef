# The program on Debian 12, with Debian's COLMAP beside it (docs/packages.md):
#
#   docker build --tag dgsfm .
#   docker run --rm --volume "$PWD:/data" dgsfm depth_global_mapper \
#     --database_path my.db --output_path model

FROM debian:12-slim AS build
WORKDIR /src
COPY . .
RUN scripts/build_packages.sh

FROM debian:12-slim
COPY --from=build /src/build/release/packages/dgsfm_*.deb /tmp/
# Versions are those of Debian 12. colmap extracts and matches features.
# hadolint ignore=DL3008
RUN apt-get update \
  && apt-get install --yes --no-install-recommends colmap /tmp/dgsfm_*.deb \
  && rm -rf /var/lib/apt/lists/* /tmp/dgsfm_*.deb
# "colmap" is this program; COLMAP's own commands find no display.
ENV PATH=/usr/lib/dgsfm/bin:$PATH \
    QT_QPA_PLATFORM=offscreen
WORKDIR /data
ENTRYPOINT ["colmap"]
CMD ["help"]
