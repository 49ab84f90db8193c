# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: E501
"""Clean sweeps of public repositories: which ``scripts/more_sweeps`` decodes, and ``train`` reads."""

import csv

# ouster-lidar/ouster-sdk at 46b7bceee7995914e2f3f3facf4d78418335b2d7, BSD-3-Clause; part: serial number.
# tier4/nebula at 606ac41f1f136333915f0114736f2f828e9d2789, Apache-2.0; part: blocks of the packets.
# The SHA-256 is that of the sweep decoded.
TABLE = """file,sensor,repository,path,part,rings,sha256
os0_128_street.pcd,OS0-128,ouster-sdk,pcaps/OS-0-128-U1_v2.3.0_1024x10.pcap,122150000150,,450f392a4512351ed3816935fe1a83ef9c54cf2ecb9e8633741e23e953067493
os0_128_street2.pcd,OS0-128,ouster-sdk,osfs/single_scan_016.osf,122246001228,,7992b23d864b3818b744ab3291b836fd0f10d73a525f9c6a1b2999b3a5f98002
os0_128_tilted.pcd,OS0-128,ouster-sdk,osfs/pose_delta_1_128.osf,122305001639,,5de93fa381941e7241481d6749cdc51f6793793b086ec22ca8ffff76dcb7c0ab
os1_128_tilted.pcd,OS1-128,ouster-sdk,osfs/pose_delta_1_128.osf,122251000331,,e46c8acdd6efc353b8082cd46bd924aec1de2e9876b3e7ec291ff102ba994a89
os1_128_crossing.pcd,OS1-128,ouster-sdk,osfs/pose_delta_2_128.osf,122428000947,,a0eb56452d17c9be55831690bd286ac229a31d23700928af58e93159b76ae9ef
os1_128_crossing2.pcd,OS1-128,ouster-sdk,osfs/pose_delta_2_128.osf,122510000820,,2cb6c0c90b3fccb820f17b72a3e66c7a62646cec141035249be1340445cc619f
os1_32_street.pcd,OS1-32,ouster-sdk,pcaps/OS-1-32-G_v2.1.1_1024x10.pcap,992101000280,,09510419afc58491e5a945cce45f090ab919f5e974dbb01d6397d25bb67c8a24
os2_128_street.pcd,OS2-128,ouster-sdk,pcaps/OS-2-128-U1_v2.3.0_1024x10.pcap,992210000957,,74150755c56ea5f58835d75efe227823d04ab4a52d541d5183949582d21249a4
os2_32_street.pcd,OS2-32,ouster-sdk,pcaps/OS-2-32-U0_v2.0.0_1024x10.pcap,992029000352,,3da55bace0fceb8cd39ce77616c40859e7a75b834ca3c70e8ff975ccd814630e
qt128_0.pcd,QT128,nebula,qt128/1730273789074637152/1730273789074637152_0.db3,1746-3546,QT128,d98f1e5bfed5e502735a65d44943370528b2f8bd5c6e9c1f6bf8041569aa91ed
qt128_1.pcd,QT128,nebula,qt128/1730273789074637152/1730273789074637152_0.db3,0-1746,QT128,031b979a9504cf6d16123e926489bb37b049be6eed68f9d9ac8e85233d9ec4a6
xt16_0.pcd,XT16,nebula,xt16/1732848127890747768/1732848127890747768_0.db3,1004-5004,XT16,7687ff3a54bdf9281532a51aae8899a06a144a5079ad63fd80107513e24c98e3
xt16_1.pcd,XT16,nebula,xt16/1732848127890747768/1732848127890747768_0.db3,9004-13004,XT16,3de4fa98f3c060e06210c4d4aa50d33c9639c6a87f002b76d7287512a76d99e6
xt32m_0.pcd,XT32,nebula,xt32m/1660893203042895158/1660893203042895158_0.db3,0-3992,XT32M,95548fe23b10d5655fdd1c36b81a07791e3a64f3ee47346873a3baaf036541ed
xt32m_1.pcd,XT32,nebula,xt32m/1660893203042895158/1660893203042895158_0.db3,5514-9250,XT32M,7eac05948dc3853aca62ac1540d3d9498e4f5ed25aceb5ee5a4d8ab71e46985e
"""
SWEEPS = tuple(csv.DictReader(TABLE.splitlines()))
