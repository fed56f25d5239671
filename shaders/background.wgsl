// The background behind the model: one triangle over the whole target. viewer/src/gpu/background.rs.

struct BackgroundOut {
    @builtin(position) clip: vec4<f32>,
    @location(0) down: f32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> BackgroundOut {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    var out: BackgroundOut;
    out.clip = vec4<f32>(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0);
    out.down = corner.y * frame.tile_scale + frame.tile_shift;
    return out;
}

@fragment
fn fragment(in: BackgroundOut) -> @location(0) vec4<f32> {
    // Mixed in encoded values, where equal steps look equal; one level of noise hides the bands.
    let noise = pixel_noise(in.clip.xy) - 0.5;
    let encoded = mix(srgb_from_linear(frame.top.rgb), srgb_from_linear(frame.bottom.rgb), in.down);
    let alpha = mix(frame.top.a, frame.bottom.a, in.down);
    return vec4<f32>(linear_from_srgb(max(encoded + noise * alpha / 255.0, vec3<f32>(0.0))), alpha);
}
