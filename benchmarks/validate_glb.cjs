// Checks .glb files with the Khronos group's validator; exit code 1 for any error, warning or hint.
//
//     npm install gltf-validator
//     node benchmarks/validate_glb.cjs scene.glb trial.glb
//
// The module is looked for in the working directory.

const { createRequire } = require("node:module");
const { readFileSync } = require("node:fs");
const { join } = require("node:path");

const validator = createRequire(join(process.cwd(), "package.json"))("gltf-validator");

async function main() {
  for (const file of process.argv.slice(2)) {
    const { issues, info } = await validator.validateBytes(new Uint8Array(readFileSync(file)));
    const { numErrors, numWarnings, numInfos, numHints } = issues;
    console.log(
      `${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} remarks, ` +
        `${numHints} hints; ${info.totalTriangleCount} triangles, ${info.animationCount} animations`
    );
    for (const { code, message, pointer } of issues.messages) {
      console.log(`  ${code} ${pointer}: ${message}`);
    }
    if (issues.messages.length) process.exitCode = 1;
  }
}

main();
