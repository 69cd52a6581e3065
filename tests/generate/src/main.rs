//! Code, client and description of `proto/poselight.proto`, in their places of the tree. With
//! `--check` nothing is written: it fails where one of them is not what the interface gives.

use std::error::Error;
use std::fs;
use std::path::Path;

const PROTO: &str = "poselight.proto";

/// What is made from the interface, by its place in the tree.
fn made(root: &Path) -> Result<Vec<(&'static str, Vec<u8>)>, Box<dyn Error>> {
    let mut compiler = protox::Compiler::new([root.join("proto")])?;
    compiler.include_imports(true).include_source_info(true).open_file(PROTO)?;
    let commented = compiler.file_descriptor_set();
    compiler.include_source_info(false);
    let code = |server: bool| -> Result<Vec<u8>, Box<dyn Error>> {
        let name = format!("poselight-generate-{}-{server}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        fs::create_dir_all(&folder)?;
        tonic_prost_build::configure()
            .build_server(server)
            .build_client(!server)
            .build_transport(false)
            .btree_map(".")
            .bytes(".poselight.v1.Frame.values")
            .out_dir(&folder)
            .compile_fds(commented.clone())?;
        let code = fs::read(folder.join("poselight.v1.rs"))?;
        fs::remove_dir_all(&folder)?;
        Ok(code)
    };
    Ok(vec![
        ("src/serve/grpc/poselight.v1.rs", code(true)?),
        ("src/serve/grpc/descriptor.bin", compiler.encode_file_descriptor_set()),
        ("tests/serve/grpc/poselight.v1.rs", code(false)?),
    ])
}

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let check = std::env::args().any(|word| word == "--check");
    for (place, bytes) in made(&root)? {
        let path = root.join(place);
        if !check {
            fs::create_dir_all(path.parent().ok_or("no folder")?)?;
            fs::write(&path, &bytes)?;
        } else if fs::read(&path)? != bytes {
            return Err(format!("{place} is not that of {PROTO}; `make grpc` writes it").into());
        }
    }
    Ok(())
}
