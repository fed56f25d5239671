// Uniforms that every pass shares, and the one way from lattice points to clip space. Put in front of each pass.
// The same structs are written by viewer/src/gpu/frame.rs; a test compares the layouts.

struct Frame {
    // Takes f32(position - cell) to clip space; depth is reversed.
    clip_from_cell: mat4x4<f32>,
    // The eye, in steps from the cell, and 1; parallel projection: the direction to the eye, and 0.
    eye_from_cell: vec4<f32>,
    // Direction to the key light, a unit vector.
    light: vec4<f32>,
    // Direction to the raking light, a unit vector.
    rake: vec4<f32>,
    // Background at the top and bottom of the picture, linear, alpha premultiplied.
    top: vec4<f32>,
    bottom: vec4<f32>,
    // To the right and to the top of the picture. Steps that a pixel shows at depth z: right.w * z + up.w.
    right: vec4<f32>,
    up: vec4<f32>,
    // Depth z of a value d of the depth buffer: perspective near / d, parallel far - d * (far - near). near, far, far - near, and
    // 1 in perspective or 0.
    depth: vec4<f32>,
    // The plane of height and distance: dot(xyz, p - cell) + w, in steps.
    plane: vec4<f32>,
    // Half-spaces that cut: kept is where dot(xyz, p - cell) <= w. The plane, then the faces of the box.
    clip: array<vec4<f32>, 7>,
    // Positions are counted from this lattice point.
    cell: vec3<i32>,
    // 1: the edge of a cut is smoothed by the samples that it covers.
    smooth_cut: u32,
    // Where this tile lies in the picture: y = scale * tile_y + shift, from 0 (top) to 1.
    tile_scale: f32,
    tile_shift: f32,
    // Lamp at the eye on the scan's colours, 0 to 1.
    shading: f32,
    // Tint of back faces, 0 to 1.
    back_tint: f32,
    // Range of the error scale: log2 of metres.
    error_low: f32,
    error_high: f32,
    // Distance from the plane where the colours begin, and 1 / (end - begin).
    range_low: f32,
    range_scale: f32,
    // Curvature and eye-dome lighting: strength 0 to 1, radius in pixels, size of a feature in steps.
    strength: f32,
    radius: f32,
    feature: f32,
    // Width of the line along a cut, pixels.
    outline: f32,
    // From a pixel of the target to the pixel of the depth and normal buffer.
    depth_normal_shift: vec2<i32>,
    // Bit 0: the plane cuts; bit 1: the box cuts; bit 2: what is inside of the box goes.
    clip_flags: u32,
    // 1: modes of light show the scan's colours.
    on_color: u32,
    // Scalar where the colours begin, and 1 / (end - begin), as shares of the channel's range.
    scalar_low: f32,
    scalar_scale: f32,
    unused: vec2<u32>,
}

struct Draw {
    // Number of the draw, from 1.
    id: u32,
    // Level of detail.
    level: u32,
    // Certified error in metres.
    error: f32,
    // While levels fade into each other, the pixels whose noise lies between two values: low in the lower 16 bits,
    // high in the upper ones, of 65535. 0xffff0000: all of them.
    fade: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
// Depth and normals of the whole picture, for modes that look at the neighbourhood: shaders/depth_normal.wgsl.
@group(0) @binding(1) var depth_normal: texture_2d<u32>;
@group(1) @binding(0) var<uniform> draw: Draw;

// Exact up to the one conversion: equal lattice points give equal results in every chunk and every pass.
fn steps_from_cell(position: vec3<i32>) -> vec3<f32> {
    return vec3<f32>(position - frame.cell);
}

// How far inside of what stays a point is, in steps; negative where it is cut away.
fn clip_depth(from_cell: vec3<f32>) -> f32 {
    var inside = 1e30;
    if (frame.clip_flags & 1u) != 0u {
        inside = frame.clip[0].w - dot(frame.clip[0].xyz, from_cell);
    }
    if (frame.clip_flags & 2u) != 0u {
        var in_box = 1e30;
        for (var k = 1; k < 7; k++) {
            in_box = min(in_box, frame.clip[k].w - dot(frame.clip[k].xyz, from_cell));
        }
        inside = min(inside, select(in_box, -in_box, (frame.clip_flags & 4u) != 0u));
    }
    return inside;
}

// Noise of a pixel, 0 to 1, evenly spread in every neighbourhood (interleaved gradient noise, Jimenez 2014).
fn pixel_noise(pixel: vec2<f32>) -> f32 {
    return fract(52.9829189 * fract(dot(pixel, vec2<f32>(0.06711056, 0.00583715))));
}

// Whether this draw has this pixel while levels fade: of the draws that replace each other, exactly one has it.
fn fades_out(pixel: vec2<f32>) -> bool {
    let value = u32(pixel_noise(floor(pixel)) * 65535.0);
    return value < (draw.fade & 0xffffu) || value >= (draw.fade >> 16u);
}
