"""A lever with a slider on it, as a URDF."""

URDF = """<robot name="lever"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="0.3"/>
<inertia ixx="0.0002" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="slider"><inertial><origin xyz="0 0 0"/><mass value="0.2"/>
<inertia ixx="0.0001" iyy="0.0001" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<dynamics damping="0.05"/><limit lower="-2" upper="2" effort="0.5" velocity="5"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="slider"/><axis xyz="1 0 0"/>
<dynamics damping="2"/><limit lower="-0.1" upper="0.1" effort="2" velocity="1"/></joint></robot>"""
