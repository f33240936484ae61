# sheetsplat in a container: docker build -t sheetsplat . && docker run --rm -v "$PWD:/data" sheetsplat render FILE -o x.png
FROM debian:12-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends \
        g++ libglm-dev libhwy-dev libpng-dev python3-dev python3-venv && rm -rf /var/lib/apt/lists/*
COPY . /source
RUN python3 -m venv /opt/sheetsplat && /opt/sheetsplat/bin/pip install --no-cache-dir "/source[plot,medical,science]"

FROM debian:12-slim
# libEGL and Mesa serve the backend gl, with the host's driver where the container is given one.
RUN apt-get update && apt-get install -y --no-install-recommends \
        libegl1 libegl-mesa0 libgl1-mesa-dri libpng16-16 python3 && rm -rf /var/lib/apt/lists/*
COPY --from=build /opt/sheetsplat /opt/sheetsplat
ENV PATH=/opt/sheetsplat/bin:$PATH XDG_CACHE_HOME=/tmp/cache
WORKDIR /data
USER nobody
ENTRYPOINT ["sheetsplat"]
CMD ["--help"]
