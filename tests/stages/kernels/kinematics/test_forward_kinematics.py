import mujoco
import numpy as np
import torch

from stages.kernels.kinematics.forward_kinematics import forward_kinematics

# A three-joint chain with a side branch, axes and anchors given in world coordinates at zero position.
MJCF = """
<mujoco>
  <worldbody>
    <body name="b0"><geom size="0.1"/>
      <body name="b1"><joint type="hinge" axis="0 0 1" pos="0.5 0 0"/><geom size="0.1"/>
        <body name="b2"><joint type="slide" axis="0.6 0.8 0" pos="0 0 0"/><geom size="0.1"/></body>
        <body name="b3"><joint type="hinge" axis="0 1 0" pos="1 0.2 0.3"/><geom size="0.1"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = [(0, 1), (1, 2), (1, 3)]
AXIS = torch.tensor([[0, 0, 1.0], [0.6, 0.8, 0], [0, 1.0, 0]], dtype=torch.float64)
POINT = torch.tensor([[0.5, 0, 0], [0, 0, 0], [1, 0.2, 0.3]], dtype=torch.float64)


def test_agrees_with_mujoco():
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    positions = np.random.default_rng(0).uniform(-1, 1, size=(6, 3))
    states = np.zeros((3, 6, 2))
    for joint, column in enumerate((0, 1, 0)):
        states[joint, :, column] = positions[:, joint]
    identity = torch.eye(4, dtype=torch.float64).expand(6, 4, 4)
    Ts = forward_kinematics(identity, JOINTS, AXIS, POINT, torch.from_numpy(states), 0).numpy()
    for frame in range(6):
        data.qpos[:] = positions[frame]
        mujoco.mj_kinematics(model, data)
        for part in range(4):
            body = model.body(f"b{part}").id
            np.testing.assert_allclose(Ts[frame, part, :3, :3], data.xmat[body].reshape(3, 3), atol=1e-9)
            np.testing.assert_allclose(Ts[frame, part, :3, 3], data.xpos[body], atol=1e-9)


def test_a_moving_root_carries_every_part():
    T_root = torch.eye(4, dtype=torch.float64).repeat(2, 1, 1)
    T_root[1, :3, 3] = torch.tensor([1.0, 2.0, 3.0])
    Ts = forward_kinematics(T_root, JOINTS, AXIS, POINT, torch.zeros(3, 2, 2, dtype=torch.float64), 0)
    np.testing.assert_allclose(Ts[1, :, :3, 3].numpy(), np.tile([1.0, 2.0, 3.0], (4, 1)))
