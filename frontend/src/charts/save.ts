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
