/** Where the service is: beside this page, whatever path a reverse proxy has put before it. */

/** Address of the folder that this page is in, without its last slash; empty where there is no page. */
export const BASE: string =
  globalThis.location === undefined ? "" : folderOf(globalThis.location.href).replace(/\/$/, "");

/** Whole address of a path of the service, such as "/api/control". */
export function addressOf(path: string): string {
  return BASE + path;
}

/** Path of the service in the address of a request to it, without what a proxy has put before it. */
export function pathOf(address: string): string {
  const path = new URL(address).pathname;
  const before = BASE === "" ? "" : new URL(BASE).pathname.replace(/\/$/, "");
  return path.startsWith(`${before}/`) ? path.slice(before.length) : path;
}

/** Address of the live stream beside the page at an address. */
export function liveUrl(page: string): string {
  return new URL("api/live", folderOf(page).replace(/^http/, "ws")).href;
}

function folderOf(page: string): string {
  return new URL("./", page.replace(/[?#].*$/, "")).href;
}
