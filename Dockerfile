# One image per service: --target service --build-arg SERVICE=physics, and so on.
FROM python:3.11-slim-bookworm AS base
ARG PIP_INDEX_URL
ENV PIP_CONSTRAINT=/constraints.txt PIP_NO_CACHE_DIR=1 PIP_QUIET=1 PIP_ROOT_USER_ACTION=ignore \
    PIP_DISABLE_PIP_VERSION_CHECK=1
COPY constraints.txt /

FROM base AS wheel
COPY . /src
RUN pip wheel --no-deps -w /wheels /src

# all images share these layers; the router needs no more. ROS 2 is among them, since
# bus.ros2=true is for all services, and a scenario may name a map
FROM base AS sdk
COPY --from=wheel /wheels /wheels
RUN pip install "$(echo /wheels/*.whl)[ros2,maps]"
WORKDIR /mecazen
USER 1000:1000
ENTRYPOINT ["mecazen"]

FROM sdk AS service
USER root
ARG SERVICE
# DART links against OpenGL for a window that nobody opens here: the libraries alone do, without
# the 200 MB of drivers that apt-get install would bring
RUN case $SERVICE in physics) \
        cd /tmp && apt-get update -qq && apt-get download -qq libgl1 libglvnd0 libglx0 \
            libx11-6 libxcb1 libxau6 libxdmcp6 libbsd0 libmd0 && \
        for package in *.deb; do dpkg -x $package /; done && \
        rm -rf *.deb /var/lib/apt/lists/* /var/cache/apt/*.bin; \
    esac
RUN pip install "$(echo /wheels/*.whl)[$SERVICE]"
USER 1000:1000
