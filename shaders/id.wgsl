// Which draw covers a pixel, and at which depth: for picking and for tests. viewer/src/gpu/id.rs.
// Two unsigned integers: the number of the draw (0: nothing) and the bits of the depth.

struct IdOut {
    @invariant @builtin(position) clip: vec4<f32>,
    @location(0) from_cell: vec3<f32>,
}

@vertex
fn vertex(@location(0) position: vec3<i32>) -> IdOut {
    var out: IdOut;
    out.from_cell = steps_from_cell(position);
    out.clip = frame.clip_from_cell * vec4<f32>(out.from_cell, 1.0);
    return out;
}

@fragment
fn fragment(in: IdOut) -> @location(0) vec2<u32> {
    return vec2<u32>(draw.id, bitcast<u32>(in.clip.z));
}

@fragment
fn fragment_cut(in: IdOut) -> @location(0) vec2<u32> {
    if clip_depth(in.from_cell) < 0.0 {
        discard;
    }
    return vec2<u32>(draw.id, bitcast<u32>(in.clip.z));
}
