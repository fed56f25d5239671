//! Without a GPU: every shader is valid WGSL, stays within WebGL2, and agrees with Rust about memory layout.

use kilwa_viewer::Mode;
use kilwa_viewer::gpu::frame::{Draw, Frame};
use kilwa_viewer::gpu::{SHADERS, pool};

fn parse(name: &str, source: &str) -> naga::Module {
    naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{name}.wgsl: {}", e.emit_to_string(source)))
}

#[test]
fn every_shader_is_valid_within_the_baseline_capabilities() {
    for (name, source) in SHADERS {
        let module = parse(name, source);
        let mut validator =
            naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty());
        validator.validate(&module).unwrap_or_else(|e| panic!("{name}.wgsl: {}", e.emit_to_string(source)));
    }
}

#[test]
fn no_shader_needs_more_than_webgl2_has() {
    for (name, source) in SHADERS {
        for (_, variable) in parse(name, source).global_variables.iter() {
            assert!(
                matches!(variable.space, naga::AddressSpace::Uniform | naga::AddressSpace::Handle),
                "{name}.wgsl uses {:?}, which WebGL2 has not",
                variable.space
            );
        }
    }
}

#[test]
fn every_entry_point_translates_to_webgl2_glsl_in_every_mode() {
    for (name, source) in SHADERS {
        let module = parse(name, source);
        let info = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{name}.wgsl: {}", e.emit_to_string(source)));
        let has_modes = module.overrides.iter().any(|(_, o)| o.name.as_deref() == Some("mode"));
        assert_eq!(has_modes, name == "surface", "{name}.wgsl");
        for mode in 0..if has_modes { Mode::ALL.len() as u32 } else { 1 } {
            for entry in &module.entry_points {
                let constants = has_modes.then(|| ("mode".to_owned(), f64::from(mode)));
                let constants = constants.into_iter().collect();
                let chosen = Some((entry.stage, entry.name.as_str()));
                let (module, info) =
                    naga::back::pipeline_constants::process_overrides(&module, &info, chosen, &constants)
                        .unwrap_or_else(|e| panic!("{name}.wgsl, {}, mode {mode}: {e}", entry.name));
                assert_translates(name, &module, &info, entry);
            }
        }
    }
}

fn assert_translates(name: &str, module: &naga::Module, info: &naga::valid::ModuleInfo, entry: &naga::EntryPoint) {
    use naga::back::glsl;
    let options =
        glsl::Options { version: glsl::Version::Embedded { version: 300, is_webgl: true }, ..glsl::Options::default() };
    let pipeline =
        glsl::PipelineOptions { shader_stage: entry.stage, entry_point: entry.name.clone(), multiview: None };
    let mut text = String::new();
    let policies = naga::proc::BoundsCheckPolicies::default();
    let written =
        glsl::Writer::new(&mut text, module, info, &options, &pipeline, policies).and_then(|mut writer| writer.write());
    assert!(written.is_ok(), "{name}.wgsl, {}: {:?}", entry.name, written.err());
    assert!(text.contains("void main()") && !text.contains("imageLoad"), "{name}.wgsl, {}", entry.name);
}

#[test]
fn positions_are_invariant_in_every_pass_that_draws_chunks() {
    for (name, source) in SHADERS.iter().filter(|(name, _)| !["background", "present"].contains(name)) {
        assert!(source.contains("@invariant @builtin(position)"), "{name}.wgsl");
        assert!(source.contains("frame.clip_from_cell * vec4<f32>("), "{name}.wgsl");
    }
}

/// Fields of a WGSL struct: name, offset and bytes.
fn layout(module: &naga::Module, name: &str) -> Vec<(String, usize, usize)> {
    let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).expect("the struct exists");
    let naga::TypeInner::Struct { members, .. } = &found.inner else { panic!("{name} is no struct") };
    members
        .iter()
        .map(|m| {
            let size = module.types[m.ty].inner.size(module.to_ctx());
            (m.name.clone().expect("named"), m.offset as usize, size as usize)
        })
        .collect()
}

/// Bytes of a field.
fn size<T, F>(_: fn(&T) -> &F) -> usize {
    size_of::<F>()
}

/// Fields of a Rust struct: name, offset and bytes.
macro_rules! fields {
    ($of:ident: $($name:ident)*) => {
        vec![$((stringify!($name).to_owned(), std::mem::offset_of!($of, $name), size(|s: &$of| &s.$name))),*]
    };
}

#[test]
fn uniforms_have_the_memory_layout_the_shaders_expect() {
    let frame = fields!(Frame: clip_from_cell eye_from_cell light rake top bottom right up depth plane clip cell smooth_cut
        tile_scale tile_shift shading back_tint error_low error_high range_low range_scale strength radius feature outline
        depth_normal_shift clip_flags on_color scalar_low scalar_scale unused);
    let draw = fields!(Draw: id level error fade);
    for (name, source) in SHADERS.iter().filter(|(name, _)| *name != "present") {
        let module = parse(name, source);
        assert_eq!(layout(&module, "Frame"), frame, "{name}.wgsl");
        assert_eq!(layout(&module, "Draw"), draw, "{name}.wgsl");
    }
    for (bytes, fields) in [(size_of::<Frame>(), &frame), (size_of::<Draw>(), &draw)] {
        assert_eq!(bytes, fields.iter().map(|(_, _, size)| size).sum::<usize>(), "the list names every field");
        assert_eq!(bytes % 16, 0);
    }
}

#[test]
fn vertex_attributes_cover_the_vertex_of_the_pack() {
    let mut at = 0;
    for attribute in pool::ATTRIBUTES {
        assert_eq!(attribute.offset, at);
        at += attribute.format.size();
    }
    assert_eq!(at as usize, kilwa_pack::vertex_layout::VERTEX_BYTES);
}
