//! Files of other tools that are known and not read: by name, with what turns them into something that is.

use std::path::Path;

use super::Error;

/// A format that is not read.
struct Foreign {
    /// As people know it.
    name: &'static str,
    extensions: &'static [&'static str],
    mark: fn(&[u8]) -> bool,
    help: &'static str,
}

fn never(_: &[u8]) -> bool {
    false
}

const FOREIGN: &[Foreign] = &[
    Foreign {
        name: "a recording of ROS (bag)",
        extensions: &["bag", "db3", "mcap"],
        mark: |b| {
            b.starts_with(b"#ROSBAG")
                || b.starts_with(b"\x89MCAP0\r\n")
                || b.starts_with(b"SQLite format 3\0")
        },
        help: "Write its clouds as PCD: `ros2 run pcl_ros bag_to_pcd` or `rosrun pcl_ros bag_to_pcd`; depth images with \
               `image_saver`, and their poses into a scan.json",
    },
    Foreign {
        name: "a frame of Zivid (zdf)",
        extensions: &["zdf"],
        mark: never,
        help: "Save it as PLY or PCD: in Zivid Studio by File, Export, or with frame.save(\"cloud.ply\")",
    },
    Foreign {
        name: "a recording of Rerun (rrd)",
        extensions: &["rrd"],
        mark: |b| b.starts_with(b"RRF"),
        help: "Save the points themselves as PLY, PCD or .npy where they are logged",
    },
    Foreign {
        name: "a CAD model (STEP, IGES)",
        extensions: &["step", "stp", "iges", "igs"],
        mark: |b| b.starts_with(b"ISO-10303-21"),
        help: "Export its mesh as STL or OBJ, for instance with FreeCAD",
    },
    Foreign {
        name: "a scene in glTF or 3MF",
        extensions: &["glb", "gltf", "3mf"],
        mark: |b| b.starts_with(b"glTF"),
        help: "Export the mesh as STL, OBJ or PLY, for instance with Blender or MeshLab",
    },
    Foreign {
        name: "arrays of NumPy in an archive (npz)",
        extensions: &["npz"],
        mark: never,
        help: "Save the array of points alone: numpy.save(\"cloud.npy\", points)",
    },
    Foreign {
        name: "VTK's XML",
        extensions: &["vtp", "vtu", "vts", "vti"],
        mark: |b| contains(b, b"<VTKFile"),
        help: "Save it as PLY or as legacy .vtk, for instance with ParaView",
    },
    Foreign {
        name: "a launch file of ROS (MoveIt's calibration saves one)",
        extensions: &["launch"],
        mark: |b| contains(b, b"<launch"),
        help: "Take the numbers of its static_transform_publisher, x y z qx qy qz qw, as \
               {\"xyz\": [x, y, z], \"quaternion_xyzw\": [qx, qy, qz, qw]}",
    },
    Foreign {
        name: "XML of ViSP or OpenCV",
        extensions: &["xml"],
        mark: |b| contains(b, b"<camera>") || contains(b, b"<opencv_storage>"),
        help: "Give its numbers in scan.json: a camera as width, height, fx, fy, cx, cy, a transform as a 4x4 matrix row by row",
    },
    Foreign {
        name: "an image in a format that is not read as depth",
        extensions: &["jpg", "jpeg", "tif", "tiff", "exr", "pgm", "bmp"],
        mark: never,
        help: "Depth images are read as 16-bit greyscale PNG",
    },
];

/// Text of two bytes a character, as some programs on Windows save it.
fn is_utf16(bytes: &[u8]) -> bool {
    matches!(bytes, [0xff, 0xfe, first, 0, ..] | [0xfe, 0xff, 0, first, ..] if *first != 0)
}

fn contains(bytes: &[u8], word: &[u8]) -> bool {
    /// A mark stands near the beginning.
    const HEAD: usize = 2048;
    bytes[..bytes.len().min(HEAD)].windows(word.len()).any(|window| window == word)
}

/// Refuses what is known by its bytes, whatever its name.
pub(super) fn refuse(bytes: &[u8], path: &Path) -> Result<(), Error> {
    if is_utf16(bytes) {
        let help = "Save it as UTF-8: in an editor by Save As, in PowerShell with -Encoding utf8";
        return Err(Error::malformed(path, "byte 0", "it is text in UTF-16, which is not read", help));
    }
    FOREIGN.iter().find(|format| (format.mark)(bytes)).map_or(Ok(()), |format| Err(format.error(path)))
}

/// The same of a name whose bytes no reader takes.
pub(super) fn by_name(path: &Path) -> Option<Error> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    let known = |format: &&Foreign| format.extensions.contains(&extension.as_str());
    FOREIGN.iter().find(known).map(|format| format.error(path))
}

impl Foreign {
    fn error(&self, path: &Path) -> Error {
        Error::malformed(path, "byte 0", format!("it is {}, which is not read", self.name), self.help)
    }
}

/// The benchmark for object poses: what its folder of a scene is known by.
const BOP: &str = "scene_camera.json";

/// Refuses a folder that is known and not read.
pub(super) fn refuse_folder(folder: &Path) -> Result<(), Error> {
    if folder.join(BOP).is_file() {
        let problem = "it is a scene of the BOP benchmark, which is not read";
        let help = "Write a scan.json: `camera` from cam_K (fx, fy, cx, cy) and depth_scale / 1000 as depth_scale_m, \
                    \"units\": \"mm\", and for each image in depth/ a `base_from_camera` that is the inverse of \
                    cam_R_w2c and cam_t_w2c";
        return Err(Error::malformed(folder, BOP, problem, help));
    }
    if folder.join("metadata.yaml").is_file() {
        let recorded =
            |name: &std::ffi::OsStr| [".db3", ".mcap"].iter().any(|e| name.to_string_lossy().ends_with(e));
        let mut entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
        if let Some(recording) = entries.find(|entry| recorded(&entry.file_name())) {
            return by_name(&recording.path()).map_or(Ok(()), Err);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_files_are_known_by_bytes_or_by_name() {
        for (bytes, word) in [
            (&b"#ROSBAG V2.0\n"[..], "bag"),
            (b"ISO-10303-21;\nHEADER;", "STEP"),
            (b"\xff\xfe{\0\n\0", "UTF-16"),
            (b"\xfe\xff\0{\0\n", "UTF-16"),
            (b"<?xml version=\"1.0\"?>\n<launch>\n", "launch"),
            (b"<?xml version=\"1.0\"?>\n<root>\n  <camera>\n", "ViSP"),
        ] {
            let error = refuse(bytes, Path::new("a.dat")).unwrap_err().to_string();
            assert!(error.contains("a.dat") && error.contains(word), "{error}");
        }
        assert!(
            refuse(b"ply\n", Path::new("a.ply")).is_ok() && refuse(b"\xff\xfe\0\0", Path::new("a")).is_ok()
        );
        for (name, word) in
            [("A.ZDF", "Zivid"), ("a.rrd", "Rerun"), ("a.npz", "numpy.save"), ("a.stp", "FreeCAD")]
        {
            assert!(by_name(Path::new(name)).unwrap().to_string().contains(word), "{name}");
        }
        assert!(by_name(Path::new("a.las")).is_none());
    }
}
