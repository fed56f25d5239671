//! Pictures for targets that store what they get are those of targets that encode by themselves, along edges too.

use glam::{DVec3, IVec3};
use kilwa_geometry::{Lattice, normal};
use kilwa_pack::{Chunk, NO_DIAMOND, PatchRange, interleave};
use kilwa_stream::DrawPatch;
use kilwa_viewer::renderer::IMAGE_FORMAT;
use kilwa_viewer::{Background, Bounds, Camera, Gpu, Image, Prefer, RenderOptions, Renderer, StandardView};

/// A white square, rotated.
fn square() -> Chunk {
    let mut chunk = Chunk::default();
    chunk.mesh.positions =
        [[1000, 5000, 2000], [8000, 5000, 1000], [9000, 5000, 8000], [2000, 5000, 9000]].map(IVec3::from).to_vec();
    chunk.mesh.normals = vec![normal::encode(DVec3::NEG_Y); 4];
    chunk.mesh.colors = vec![[255; 3]; 4];
    chunk.mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
    chunk.mesh.borders = vec![0; 2];
    chunk.patches = vec![PatchRange { first: 0, count: 2, diamond: NO_DIAMOND }];
    chunk
}

fn picture(gpu: &Gpu, format: wgpu::TextureFormat, background: Background) -> Image {
    let samples = gpu.samples(IMAGE_FORMAT);
    assert_eq!(samples, 4, "edges are smoothed");
    let mut renderer = Renderer::new(gpu.device.clone(), gpu.queue.clone(), format, samples);
    renderer.upload(0, &interleave(&square()));
    let bounds = Bounds { min: DVec3::ZERO, max: DVec3::splat(10_000.0) };
    let camera = Camera::standard(StandardView::South, &bounds, [64, 64]);
    let view = camera.view(&Lattice { origin: DVec3::ZERO, step_log2: 0 }, &bounds, [64, 64], 1.0);
    let patch =
        DrawPatch { chunk: 0, patch: 0, first: 0, count: 2, diamond: NO_DIAMOND, level: 0, error: 0.0, visible: true };
    let options = RenderOptions { shading: 0.0, background, ..RenderOptions::default() };
    pollster::block_on(renderer.image(&view, &[patch], &options)).expect("reads back")
}

#[test]
fn antialiased_edges_average_linear_light_on_every_target() {
    let gpu = pollster::block_on(Gpu::headless(Prefer::Software)).expect("these tests need a graphics adapter");
    println!("adapter: {}", gpu.describe());
    for background in [Background::Flat([0; 3]), Background::Flat([30, 60, 90]), Background::LIMESTONE] {
        let encoded = picture(&gpu, IMAGE_FORMAT, background);
        let plain = picture(&gpu, IMAGE_FORMAT.remove_srgb_suffix(), background);
        let worst = encoded.pixels.iter().zip(&plain.pixels).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst <= Some(1), "{background:?}: {worst:?} levels");
    }
    // Half white on black is half the light, 188 in sRGB, and not half the value.
    let on_black = picture(&gpu, IMAGE_FORMAT.remove_srgb_suffix(), Background::Flat([0; 3]));
    let values: std::collections::BTreeSet<u8> = on_black.pixels.chunks_exact(4).map(|p| p[0]).collect();
    assert!(values.range(186..=190).count() > 0 && values.range(120..=134).count() == 0, "{values:?}");
}

#[test]
fn over_a_transparent_background_colours_are_those_of_the_model_and_alpha_its_coverage() {
    let gpu = pollster::block_on(Gpu::headless(Prefer::Software)).expect("these tests need a graphics adapter");
    for (format, linear) in [(IMAGE_FORMAT, true), (IMAGE_FORMAT.remove_srgb_suffix(), false)] {
        let image = picture(&gpu, format, Background::Transparent).with_straight_alpha(linear);
        let edges: Vec<&[u8]> = image.pixels.chunks_exact(4).filter(|p| p[3] > 0 && p[3] < 255).collect();
        assert!(edges.len() > 20);
        assert!(edges.iter().all(|p| p[..3].iter().all(|v| *v >= 252)), "white stays white along its edges: {edges:?}");
    }
}
