fn main(){ let c = shaderc::Compiler::new(); println!("cargo:warning={}", c.is_ok()); }
