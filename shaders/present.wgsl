// The finished picture for a target that stores what it gets: encodes sRGB. viewer/src/gpu/present.rs.
// Samples are averaged before, as linear light, so that edges are the same on every target.

@group(0) @binding(0) var shown: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0);
}

@fragment
fn fragment(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let c = textureLoad(shown, vec2<i32>(floor(at.xy)), 0);
    // Alpha is not encoded: colours are multiplied by it again afterwards.
    return vec4<f32>(srgb_from_linear(c.rgb / max(c.a, 1e-6)) * c.a, c.a);
}
