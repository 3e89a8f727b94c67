"""A robot of few parts, and a mesh."""

import struct

URDF = """<robot name="toy">
  <material name="dark"><color rgba="0.1 0.2 0.3 1"/></material>
  <link name="base_link"><visual><origin xyz="0 0 0.1" rpy="0 0 0"/>
    <geometry><box size="0.4 0.2 0.1"/></geometry><material name="dark"/></visual></link>
  <link name="wheel"><visual><origin xyz="0 0 0" rpy="1.5 0 0"/>
    <geometry><cylinder radius="0.05" length="0.04"/></geometry></visual></link>
  <link name="roller_0"><visual><geometry><mesh filename="meshes/r.stl"/></geometry></visual></link>
  <link name="roller_1"><visual><geometry><mesh filename="meshes/r.stl"/></geometry></visual></link>
  <link name="mast"><visual><origin xyz="0.3 0 0" rpy="0 0 0"/>
    <geometry><cylinder radius="0.01" length="1"/></geometry></visual></link>
  <joint name="wheel_joint" type="continuous"><parent link="base_link"/><child link="wheel"/>
    <origin xyz="0.1 0.2 0.05" rpy="0 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="r0" type="continuous"><parent link="wheel"/><child link="roller_0"/>
    <origin xyz="0 0 -0.04" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="r1" type="continuous"><parent link="wheel"/><child link="roller_1"/>
    <origin xyz="0 0 0.04" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/></joint>
  <joint name="mast_joint" type="fixed"><parent link="base_link"/><child link="mast"/>
    <origin xyz="0 0 1" rpy="0 0 0"/></joint>
</robot>"""


def stl(*triangles: tuple[tuple[float, float, float], ...]) -> bytes:
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(x for corner in facet for x in corner), 0)
        for facet in triangles
    )
    return bytes(80) + struct.pack("<I", len(triangles)) + facets
