    .section .text.__pre_init, "ax"
    .global __pre_init
    .type __pre_init, %function
    .thumb_func
__pre_init:
    movs r0, #0
    ldr r1, =_ccm_start
    ldr r2, =_ccm_end
2:
    cmp r1, r2
    beq 3f
    str r0, [r1], #4
    b 2b
3:
    bx lr
    .ltorg
    .size __pre_init, . - __pre_init
