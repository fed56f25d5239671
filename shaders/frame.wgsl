// Uniforms that every pass shares, and the one way from lattice points to clip space. Put in front of each pass.
// The same structs are written by viewer/src/gpu/frame.rs; a test compares the layouts.

struct Frame {
    // Takes f32(position - cell) to clip space; depth is reversed.
    clip_from_cell: mat4x4<f32>,
    // The eye, in steps from the cell, and 1; parallel projection: the direction to the eye, and 0.
    eye_from_cell: vec4<f32>,
    // Direction to the key light, a unit vector.
    light: vec4<f32>,
    // Background at the top and bottom of the picture, linear, alpha premultiplied.
    top: vec4<f32>,
    bottom: vec4<f32>,
    // Positions are counted from this lattice point.
    cell: vec3<i32>,
    // 0 colour, 1 clay, 2 normals, 3 level, 4 error.
    mode: u32,
    // Where this tile lies in the picture: y = scale * tile_y + shift, from 0 (top) to 1.
    tile_scale: f32,
    tile_shift: f32,
    // 1 where the target stores what it gets and the shader has to encode sRGB.
    encode_srgb: u32,
    // Lamp at the eye on the scan's colours, 0 to 1.
    shading: f32,
    // Tint of back faces, 0 to 1.
    back_tint: f32,
    // Range of the error scale: log2 of metres.
    error_low: f32,
    error_high: f32,
    unused: f32,
}

struct Draw {
    // Number of the draw, from 1.
    id: u32,
    // Level of detail.
    level: u32,
    // Certified error in metres.
    error: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(1) @binding(0) var<uniform> draw: Draw;

// Exact up to the one conversion: equal lattice points give equal results in every chunk and every pass.
fn steps_from_cell(position: vec3<i32>) -> vec3<f32> {
    return vec3<f32>(position - frame.cell);
}

fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3<f32>(2.4)), c / 12.92, c <= vec3<f32>(0.04045));
}

fn srgb_from_linear(c: vec3<f32>) -> vec3<f32> {
    let x = clamp(c, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(1.055 * pow(x, vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * x, x <= vec3<f32>(0.0031308));
}

fn for_target(c: vec4<f32>) -> vec4<f32> {
    if frame.encode_srgb == 1u {
        return vec4<f32>(srgb_from_linear(c.rgb), c.a);
    }
    return c;
}
