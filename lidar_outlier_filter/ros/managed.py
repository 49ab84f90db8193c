# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The node as a managed one: a manager configures, activates, deactivates and cleans it up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.lifecycle import LifecycleNodeMixin, TransitionCallbackReturn

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.ros.node import OutlierFilterNode

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleState


class ManagedFilterNode(LifecycleNodeMixin, OutlierFilterNode):  # type: ignore[misc]
    """Filters while it is active.

    =============  ================================================================
    state          what there is
    =============  ================================================================
    unconfigured   parameters and services
    inactive       publishers, too, which are silent; nothing is subscribed to
    active         subscriptions and diagnostics, too
    =============  ================================================================

    What was received while it was active is answered before it is inactive.
    """

    is_managed = True

    def __init__(self, **options: Any) -> None:
        """Declare the parameters; the options are those of OutlierFilterNode."""
        OutlierFilterNode.__init__(self, **options)
        LifecycleNodeMixin.__init__(self)

    def start(self) -> None:
        """Offer the services, and wait for a manager."""
        self.serve()
        self.get_logger().info('managed: waits to be configured and activated')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the publishers by the parameters of now."""
        try:
            self.channels = self.make_channels()
        except FilterError as err:
            self.get_logger().error(f'not configured: {err}')
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe, and filter once the kernels are ready."""
        self.run()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Answer all that was received; then receive and publish nothing."""
        self._pause()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the publishers."""
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Answer all that was received, and let go of the publishers."""
        self._pause()
        self._release()
        return super().on_shutdown(state)

    def _pause(self) -> None:
        if self._is_started:
            self.finish()
            self.rest()

    def _release(self) -> None:
        for channel in self.channels:
            channel.destroy()
        self.channels = ()
