use super::*;

/// Triangles of a box.
fn block(low: [f64; 3], high: [f64; 3]) -> Vec<[Point3<f64>; 3]> {
    let at = |k: usize| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
        Point3::new(pick(0), pick(1), pick(2))
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.iter().flat_map(|[a, b, c, d]| [[at(*a), at(*b), at(*c)], [at(*a), at(*c), at(*d)]]).collect()
}

/// A rib of 8 x 80 x 40 mm in the middle of a plate of 160 x 120 x 10 mm: two bodies that touch.
fn rib_on_plate() -> MeshRequest {
    let mut triangles = block([-80.0, -60.0, -10.0], [80.0, 60.0, 0.0]);
    triangles.extend(block([-40.0, -4.0, 0.0], [40.0, 4.0, 40.0]));
    MeshRequest {
        name: "rib".into(),
        triangles,
        welds: None,
        views: 8,
        noise: Noise::Mid,
        seed: 1,
        size_px: [160, 120],
        distance_mm: None,
        format: Format::Png,
        cell: None,
        sensor: SensorErrors::default(),
    }
}

fn total(truth: &Truth) -> (usize, usize) {
    let stations = truth.seams.iter().map(|seam| seam.p.len()).sum();
    (stations, truth.seams.iter().map(|seam| seam.visible_count()).sum())
}

#[test]
fn the_corners_of_a_rib_are_its_four_sides_at_half_a_right_angle() {
    let scan = simulate_mesh(&rib_on_plate()).unwrap();
    let truth = &scan.truth;
    let mut lengths: Vec<usize> = truth.seams.iter().map(|seam| seam.p.len()).collect();
    lengths.sort_unstable();
    assert_eq!(lengths, [8, 8, 80, 80]);
    for seam in &truth.seams {
        assert!((seam.angle_deg - 90.0).abs() < 1e-6);
        assert!(seam.n.iter().all(|n| (n[2] - 0.5_f64.sqrt()).abs() < 1e-6));
        assert!(seam.p.iter().all(|p| (p[2] - (TABLE_MM + 10.0)).abs() < 1e-6), "on the plate");
    }
    let (stations, visible) = total(truth);
    assert_eq!((stations, visible), (176, 176), "nothing hides them from eight views all round");
}

#[test]
fn a_listed_torch_is_put_between_the_faces_and_short_pieces_are_left_out() {
    let weld = |start: [f64; 3], end: [f64; 3], torch: [f64; 3]| ListedWeld {
        start_mm: start.into(),
        end_mm: end.into(),
        torch: torch.into(),
    };
    // Leaning along the travel; along the rib's own side; a detour round the rib's end.
    let welds = vec![
        weld([-40.0, -4.0, 0.0], [40.0, -4.0, 0.0], [0.5, -0.6, 0.6]),
        weld([40.0, 4.0, 0.0], [-40.0, 4.0, 0.0], [0.0, 0.0, 1.0]),
        weld([40.0, -4.0, 0.0], [42.0, -4.0, 0.0], [0.0, -0.7, 0.7]),
    ];
    let scan = simulate_mesh(&MeshRequest { welds: Some(welds), ..rib_on_plate() }).unwrap();
    assert_eq!(scan.truth.seams.len(), 2);
    for seam in &scan.truth.seams {
        assert_eq!(seam.p.len(), 80);
        assert!((seam.angle_deg - 90.0).abs() < 1e-6, "{}", seam.angle_deg);
        assert!(seam.n.iter().all(|n| (n[2] - 0.5_f64.sqrt()).abs() < 1e-6));
    }
}

#[test]
fn a_list_of_welds_is_read() {
    let text = br#"{"welds": [{"start": {"xyz": [1, 2, 3], "pose": [0, 0, 1]}, "end": {"xyz": [9, 2, 3], "pose": [0, 0, 1]}}]}"#;
    let welds = ListedWeld::list(text).unwrap();
    assert_eq!((welds[0].start_mm.y, welds[0].end_mm.x, welds[0].torch.z), (2.0, 9.0, 1.0));
    assert!(ListedWeld::list(b"{\"welds\": [{}]}").unwrap_err().to_string().contains("start"));
}

#[test]
fn the_views_measure_the_mesh_where_it_is() {
    let scan = simulate_mesh(&MeshRequest { noise: Noise::None, ..rib_on_plate() }).unwrap();
    for (view, rows) in scan.views.iter().zip(&scan.truth.true_cam) {
        let camera = nalgebra::Matrix4::from_fn(|r, c| rows[r][c]);
        let above = |p: Point3<f64>| camera.transform_point(&p).z - TABLE_MM;
        let heights: Vec<f64> = view.image.points_mm(&scan.camera).into_iter().map(above).collect();
        assert!(heights.iter().all(|h| (-0.1..50.1).contains(h)));
        let on = |mm: f64| heights.iter().filter(|h| (*h - mm).abs() < 0.1).count();
        assert!(on(0.0) > 500 && on(10.0) > 500 && on(50.0) > 20, "table, plate, rib");
    }
}

#[test]
fn a_mesh_without_area_is_refused() {
    let flat = MeshRequest { triangles: vec![[Point3::origin(); 3]], ..rib_on_plate() };
    assert!(matches!(simulate_mesh(&flat), Err(Error::EmptyMesh)));
    let near = MeshRequest { distance_mm: Some(5.0), ..rib_on_plate() };
    assert!(matches!(simulate_mesh(&near), Err(Error::OutOfRange { name: "distance", .. })));
}
