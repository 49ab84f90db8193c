# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
#
# The node and all commands on ROS 2 Jazzy:
#
#   docker build -t lidar_outlier_filter .
#   docker run --rm --net=host --ipc=host lidar_outlier_filter \
#       ros2 launch lidar_outlier_filter filter.launch.py input_topic:=/velodyne_points
FROM ros:jazzy-ros-base

WORKDIR /workspace
COPY . src/lidar_outlier_filter

# What package.xml names, from apt; what apt lacks, from the list that the .deb's users take, too.
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src -y --dependency-types exec build \
    && apt-get install -y --no-install-recommends python3-pip \
    && pip install --no-cache-dir --break-system-packages --no-deps --require-hashes \
        -r src/lidar_outlier_filter/config/from_pip.txt \
    && rm -rf /var/lib/apt/lists/*

RUN . /opt/ros/jazzy/setup.sh && colcon build --packages-select lidar_outlier_filter

# The entry point of the image sources ROS; this sources the workspace, too.
RUN sed --in-place 's|^exec|source /workspace/install/setup.bash\nexec|' /ros_entrypoint.sh
# The first user of most hosts has the same number, 1000: shared memory of DDS works between equal users only, so give
# another one by `docker run --user`.
USER ubuntu
# `docker stop` sends it: at SIGTERM `ros2 launch` does not stop the node, which loses its pending clouds.
STOPSIGNAL SIGINT
CMD ["ros2", "launch", "lidar_outlier_filter", "filter.launch.py"]
