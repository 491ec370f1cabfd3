//! What runs in real time: hosts and pendants, the firmware in QEMU, hands. These tests mostly wait.

mod hands_live;
mod host_dwell;
mod host_link;
mod host_qemu;
mod pendant_guide;
mod python_client;
mod qemu_boot;
mod qemu_link;
mod qemu_port;
mod robot_end;
