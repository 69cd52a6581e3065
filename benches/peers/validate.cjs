// The official glTF validator on what `poselight apply` wrote, beside the scene that it wrote into.
//
// usage: node validate.cjs BEFORE.glb AFTER.glb ...   (npm install gltf-validator, here or in NODE_PATH)
// Prints the counts of both and every issue that is new; fails where a file has a new error or warning.

const fs = require("fs");
const path = require("path");

let validator;
try {
  validator = require(require.resolve("gltf-validator", { paths: [process.cwd(), __dirname, process.env.NODE_PATH || ""] }));
} catch {
  console.log("skipped: gltf-validator is not installed (npm install gltf-validator)");
  process.exit(0);
}

async function report(file) {
  const folder = path.dirname(file);
  const read = (uri) => fs.promises.readFile(path.join(folder, decodeURIComponent(uri)));
  const options = { uri: path.basename(file), maxIssues: 0, externalResourceFunction: read };
  return validator.validateBytes(new Uint8Array(fs.readFileSync(file)), options);
}

/// What an issue says but for the numbers, which move when accessors are added.
const kind = (issue) => `${issue.code} ${(issue.pointer || "").replace(/\d+/g, "#")}`;

async function main([before, ...files]) {
  const old = (await report(before)).issues;
  const known = new Set(old.messages.map(kind));
  console.log(`${before}: ${old.numErrors} errors, ${old.numWarnings} warnings, ${old.numInfos} infos`);
  let failed = false;
  for (const file of files) {
    const { issues, validatorVersion } = await report(file);
    const { numErrors, numWarnings, numInfos, messages } = issues;
    console.log(`${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos (validator ${validatorVersion})`);
    for (const issue of messages.filter((issue) => !known.has(kind(issue)))) {
      console.log(`  new: ${["error", "warning", "info", "hint"][issue.severity]} ${issue.code} at ${issue.pointer}: ${issue.message}`);
      failed ||= issue.severity < 2;
    }
  }
  process.exit(failed ? 1 : 0);
}

main(process.argv.slice(2));
