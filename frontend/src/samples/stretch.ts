/** A piece of the time axis [s]. */
export interface Stretch {
  readonly from_s: number;
  readonly to_s: number;
}
