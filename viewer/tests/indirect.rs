//! Draw calls that the GPU reads from a buffer draw what calls that are recorded one by one draw.

use glam::{DVec3, IVec3};
use kilwa_geometry::{Lattice, normal};
use kilwa_pack::{Chunk, NO_DIAMOND, PatchRange, interleave};
use kilwa_stream::DrawPatch;
use kilwa_viewer::{Bounds, Camera, Gpu, Mode, Prefer, RenderOptions, Renderer, StandardView};

const CHUNKS: u32 = 40;

/// Two triangles, a patch each, in a place and of a colour of its own.
fn square(index: u32) -> Chunk {
    let at = IVec3::new(index as i32 * 271 % 900, index as i32 * 97 % 700, index as i32 * 431 % 900);
    let corners = [[0, 0, 0], [90, 0, 10], [100, 20, 100], [10, 0, 90]].map(|corner| at + IVec3::from(corner));
    let mut chunk = Chunk::default();
    chunk.mesh.positions = corners.to_vec();
    chunk.mesh.normals = vec![normal::encode(DVec3::NEG_Y); 4];
    chunk.mesh.colors = vec![[(index * 6) as u8, 200, (index * 37 % 256) as u8]; 4];
    chunk.mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
    chunk.mesh.borders = vec![0; 2];
    chunk.patches = [0, 1].map(|first| PatchRange { first, count: 1, diamond: NO_DIAMOND }).to_vec();
    chunk
}

#[test]
fn calls_that_are_read_from_a_buffer_draw_the_same_picture() {
    let gpu = pollster::block_on(Gpu::headless(Prefer::Software)).expect("this test needs a graphics adapter");
    let mut renderer = Renderer::headless(&gpu);
    for index in 0..CHUNKS {
        renderer.upload(index, &interleave(&square(index)));
    }
    let bounds = Bounds { min: DVec3::ZERO, max: DVec3::splat(1000.0) };
    let camera = Camera::standard(StandardView::South, &bounds, [96, 96]);
    let view = camera.view(&Lattice { origin: DVec3::ZERO, step_log2: 0 }, &bounds, [96, 96], 1.0);
    let patches: Vec<DrawPatch> = (0..CHUNKS * 2)
        .map(|k| {
            let (chunk, patch) = (k / 2, k % 2);
            let (level, error, visible) = (chunk as u8 % 5, 0.001 * k as f32, k % 7 > 0);
            DrawPatch { chunk, patch, first: patch, count: 1, diamond: NO_DIAMOND, level, error, visible }
        })
        .collect();
    let fades: Vec<[f32; 2]> = (0..patches.len()).map(|k| [0.0, if k % 3 == 0 { 0.5 } else { 1.0 }]).collect();
    for (mode, fades) in
        [(Mode::Color, &[][..]), (Mode::Color, &fades), (Mode::Level, &[]), (Mode::Error, &[]), (Mode::EyeDome, &[])]
    {
        let options = RenderOptions { mode, ..RenderOptions::default() };
        let pictures = [true, false].map(|is_on| {
            renderer.set_indirect(is_on);
            let image =
                pollster::block_on(renderer.image_fading(&view, &patches, fades, &options)).expect("reads back");
            assert!(renderer.call_count() > 1);
            image
        });
        assert!(pictures[0] == pictures[1], "{mode:?}, {} fades", fades.len());
        assert!(pictures[0].pixels.chunks_exact(4).any(|p| p != &pictures[0].pixels[..4]), "something is drawn");
    }
}
