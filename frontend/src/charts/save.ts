/** Hands a file to the browser's downloads. */

export function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  // the download has begun once this task has ended
  setTimeout(() => URL.revokeObjectURL(link.href));
}

/** The moment as part of a file name: 2026-03-01-14-05-09, in the person's own zone. */
export function stamp(when: Date): string {
  const parts = [
    when.getMonth() + 1,
    when.getDate(),
    when.getHours(),
    when.getMinutes(),
    when.getSeconds(),
  ].map((part) => String(part).padStart(2, "0"));
  return [when.getFullYear(), ...parts].join("-");
}

/** Dots to the inch in print. */
const DPI = 300;
const MM_PER_INCH = 25.4;

/** A drawing as a picture of so many millimetres in width. Rejects where the browser cannot draw it. */
export async function pngOf(svg: string, width_mm: number): Promise<Blob> {
  const image = new Image();
  const address = URL.createObjectURL(new Blob([svg], { type: "image/svg+xml" }));
  try {
    image.src = address;
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = Math.round((width_mm / MM_PER_INCH) * DPI);
    canvas.height = Math.round((canvas.width * image.height) / image.width);
    canvas.getContext("2d")?.drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve, reject) => {
      canvas.toBlob((content) => (content === null ? reject(new Error("no picture")) : resolve(content)));
    });
  } finally {
    URL.revokeObjectURL(address);
  }
}
