# docker build -t retrue .
# docker run --rm --user "$(id -u)" --volume "$PWD:/work" retrue verify rig.json wall.jpg --pattern pattern.json
# docker run --rm --user "$(id -u)" --volume "$PWD:/work" --network host retrue studio --simulated
FROM python:3.11-slim AS build
RUN apt-get update && apt-get install --yes --no-install-recommends gcc libc6-dev && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
RUN python -m venv /opt/retrue \
    && /opt/retrue/bin/pip install --no-cache-dir --require-hashes -r requirements.lock -r requirements-studio.lock \
    && /opt/retrue/bin/pip install --no-cache-dir --no-deps .

FROM python:3.11-slim
COPY --from=build /opt/retrue /opt/retrue
ENV PATH=/opt/retrue/bin:$PATH
RUN useradd --create-home user
USER user
WORKDIR /work
ENTRYPOINT ["retrue"]
CMD ["--help"]
