# %% [markdown]
# # A RealSense camera on a UR robot: record, plan, look
#
# `record` needs the camera, the robot, and the packages `pyrealsense2` and `ur_rtde`; it has not run on hardware yet. Without them the
# views of the sample are taken.

# %%
import json

import numpy as np

import weldpath

ROBOT = None  # the robot's address, such as "192.168.0.10"
TCP = (0, 0, 0, 0, 0, 0)  # what is set as the active TCP at the controller: metres, rotation vector in rad
POSES = 6


def record(address):
    """Depth images, one for each place to which somebody moves the robot by hand, each with the pose of the flange."""
    import pyrealsense2 as rs
    import rtde_receive

    robot = rtde_receive.RTDEReceiveInterface(address)
    pipeline, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.depth, 848, 480, rs.format.z16, 30)
    profile = pipeline.start(config)
    sensor = profile.get_device().first_depth_sensor()
    # Steps of 0.1 mm in place of 1 mm: the seams become better by as much.
    sensor.set_option(rs.option.depth_units, 0.0001)
    lens = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
    views = []
    for k in range(POSES):
        input(f"view {k + 1} of {POSES}: move the robot, let it rest, and press Enter")
        for _ in range(30):  # the camera's exposure settles
            frames = pipeline.wait_for_frames()
        views.append(
            weldpath.View(
                depth=np.asanyarray(frames.get_depth_frame().get_data()).copy(),
                intrinsics=(lens.fx, lens.fy, lens.ppx, lens.ppy),
                depth_scale_m=sensor.get_depth_scale(),
                # The controller reports the pose of the active TCP.
                base_from_tcp=robot.getActualTCPPose(),
                name=f"view {k}",
            )
        )
    pipeline.stop()
    return views


def sample():
    """The same of the sample."""
    from PIL import Image

    folder = weldpath.samples.cell()
    described = json.loads((folder / "scan.json").read_text())
    camera = described["camera"]
    views = [
        weldpath.View(
            depth=np.asarray(Image.open(folder / view["depth"])).astype(np.uint16),
            intrinsics=[camera[key] for key in ("fx", "fy", "cx", "cy")],
            depth_scale_m=camera["depth_scale_m"],
            base_from_tcp=view["base_from_flange"],
            name=view["depth"],
        )
        for view in described["views"]
    ]
    return views, np.array(described["flange_from_camera"])


# %% [markdown]
# ## Plan
#
# The hand-eye transform is from your calibration, 4 x 4, metres. The job says what no scan can show: the tool.

# %%
views, hand_eye = sample() if ROBOT is None else (record(ROBOT), np.loadtxt("flange_from_camera.txt"))
tool = {"flange_from_tcp_mm": [0, 0, 300], "flange_from_tcp_rotation_rad": [0, 0, 0], "payload_kg": 2.5}
run = weldpath.plan(views, units="m", flange_from_camera=hand_eye, flange_from_tcp=TCP, job={"tool": tool}, progress=print)
print(run.verdict)
print(run.seams)

# %% [markdown]
# ## The program
#
# Look at each reason (`run.show()`), then confirm it by its id. Run the program in the controller's simulation first.

# %%
program = run.programs(["ur"], confirm=[reason.id for reason in run.verdict.reasons])["path.script"]
print(program.decode()[:600])
